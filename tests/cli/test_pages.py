"""README.md and docs/command.md, as somebody types them in the first hour: every command on disc.salt, in order, prints what stands below it."""
import pathlib
import shlex

from harness import *

PAGES = [pathlib.Path(__file__).resolve().parents[2] / name for name in ("README.md", "docs/command.md")]
NUMBER = re.compile(r"[-+]?[0-9]+(?:\.[0-9]+)?(?:e[-+]?[0-9]+)?$")


def commands(page):
    """Each `$ saltus` line of a page, and the lines indented below it."""
    found = []
    for line in page.read_text("utf-8").splitlines():
        if line.startswith("    $ "):
            found.append((line[6:].strip(), []) if line.startswith("    $ saltus ") else (None, []))
        elif line.startswith("    ") and found:
            found[-1][1].append(line.strip())
        elif line.strip():
            found.append((None, []))  # what follows this line is no output
    return [f for f in found if f[0]]


class Pages(Case):
    def same(self, shown, got):
        """Words are the same, and numbers but for their last places; bars and counts of evaluations may move more, times at will."""
        a, b = shown.split(), got.split()
        if len(a) != len(b):
            return False
        for i, (x, y) in enumerate(zip(a, b)):
            x, y = x.strip("()[],;"), y.strip("()[],;")
            if not NUMBER.match(x) or not NUMBER.match(y):
                if x != y:
                    return False
            elif a[i + 1:i + 2] in (["s"], ["evaluations,"]) or (i and a[i - 1] == "+-"):
                if a[i + 1:i + 2] != ["s"] and not 0.5 < float(x) / float(y) < 2:
                    return False
            elif abs(float(x) - float(y)) > 2e-5 * abs(float(x)):
                return False
        return True

    def test_disc(self):
        source = re.search("```salt\n(.*?)```", PAGES[0].read_text("utf-8"), re.S).group(1)
        ran, compared = 0, 0
        for page in PAGES:
            self.put("disc.salt", source)
            for command, shown in commands(page):
                words = shlex.split(command)[1:]
                if "disc.salt" not in words or words[0] in ("check", "bench"):  # their figures are noise and time
                    continue
                r = self.run_cli(*words)
                ran += 1
                lines = (r.out + r.err).splitlines()
                for line in shown:
                    if re.search("…|->|/", line) or words[0] in ("render", "build") or words[:2] == ["explain", "disc.salt"] and "--at" not in words:
                        continue
                    compared += 1
                    self.assertTrue(any(self.same(line, l) for l in lines), "%s: `%s` shows\n    %s\nand it is\n%s" % (page.name, command, line, r.out + r.err))
        self.assertGreater(ran, 10)
        self.assertGreater(compared, 15)


if __name__ == "__main__":
    unittest.main()
