"""The pages as somebody types them in the first hour: what their commands and programs print stands below them, and the commands of every example run."""
import pathlib
import shlex

from harness import *

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGES = [ROOT / name for name in ("README.md", "docs/command.md", "docs/bounds.md")]
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
            elif abs(float(x) - float(y)) > (2e-5 if abs(float(x)) > 1e-6 else 0.5) * abs(float(x)):
                return False
        return True

    def test_disc(self):
        source = re.search("```salt\n(.*?)```", PAGES[0].read_text("utf-8"), re.S).group(1)
        ran, compared = 0, 0
        for page in PAGES:
            self.put("disc.salt", source)
            for command, shown in commands(page):
                words = shlex.split(command)[1:]
                if "disc.salt" not in words or words[0] in ("check", "bench", "view"):  # figures are noise and time; a viewer does not end
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

    def test_fragment(self):
        """docs/glsl.md: its commands, on its shader."""
        page = ROOT / "docs/glsl.md"
        self.put("shader.frag", re.search("```glsl\n(.*?)```", page.read_text("utf-8"), re.S).group(1))
        self.run_cli("render", "--expr", "x.x", "--size", 4, "-o", "noise.png")
        ran = commands(page)
        for command, _ in ran:
            self.run_cli(*shlex.split(command)[1:])
        self.assertEqual(len(ran), 3)

    @unittest.skipIf(os.environ.get("SALTUS_SANITIZE"), "the programs are not built with a sanitizer")
    def test_programs(self):
        """Every program of docs/library.md and README.md compiles, runs on disc.salt and prints what the page says."""
        self.put("disc.salt", re.search("```salt\n(.*?)```", PAGES[0].read_text("utf-8"), re.S).group(1))
        build = pathlib.Path(BIN).resolve().parents[1]
        ran, compared = 0, 0
        for page in (PAGES[0], ROOT / "docs/library.md"):
            for source, behind in re.findall("```c\n(.*?)```\n(.*?)(?=```|\n#|$)", page.read_text("utf-8"), re.S):
                self.put("page.c", source)
                built = subprocess.run(["cc", "-std=c17", "-Wall", "-Wextra", "-Werror", "-I", ROOT / "include", "page.c", "-o", "page", "-L", build, "-lsaltus", "-Wl,-rpath," + str(build), "-lm"], cwd=self.dir, capture_output=True, text=True)
                self.assertEqual(built.returncode, 0, built.stderr)
                p = subprocess.run(["./page"], cwd=self.dir, capture_output=True, text=True, env=self.environment())
                self.assertEqual(p.returncode, 0, p.stderr)
                ran += 1
                for line in re.findall("^    (?!cc )(.*)$", behind, re.M):
                    compared += 1
                    self.assertTrue(any(self.same(line, l) for l in p.stdout.splitlines()), "%s shows\n    %s\nand it is\n%s" % (page.name, line, p.stdout))
        self.assertGreaterEqual(ran, 7)
        self.assertGreaterEqual(compared, 14)


class Examples(Case):
    """`examples/run --quick`: commands as they stand, in a copy of the folder, with few samples; tests/examples has the checks, and those that make terrains."""

    PAGES = [p for p in sorted(ROOT.glob("examples/*/README.md")) if p.parent.name != "notebooks"]  # tests/python has these
    ELSEWHERE = {"shadow_art", "two_suns", "shadow_edit", "glossy_edit", "terrain_views"}

    def runner(self, *args):
        return subprocess.run([ROOT / "examples/run", *args], cwd=self.dir, capture_output=True, text=True, timeout=HANGS, env=dict(self.environment(), SALTUS=BIN))

    def test_commands(self):
        ran = 0
        for page in self.PAGES:
            if page.parent.name in self.ELSEWHERE:
                continue
            with self.subTest(page.parent.name):
                p = self.runner(page.parent.name, "--quick")
                self.assertEqual(p.returncode, 0, p.stdout + p.stderr)
                ran += len(re.findall("^%s: [0-9.]+ s$" % page.parent.name, p.stdout, re.M))
        self.assertGreater(ran, 30)

    def test_runner(self):
        """Every folder is listed with what it teaches and stands on the sheet; one that is not there is said, with those that are."""
        p = self.runner("list", "sheet")
        self.assertEqual(p.returncode, 0, p.stderr)
        for page in self.PAGES:
            self.assertRegex(p.stdout, r"(?m)^%s +\S.*\.$" % page.parent.name)
            self.assertIn("/%s/" % page.parent.name, pathlib.Path(self.path("out/sheet.salt")).read_text("utf-8"))
        p = self.runner("cirlce")
        self.assertEqual(p.returncode, 2)
        self.assertIn("circle", p.stderr)

    def test_faults(self):
        """A command that fails ends the run with its status named, and a page's pictures stay as they were."""
        before = (ROOT / "examples/circle/circle.png").read_bytes()
        p = subprocess.run([ROOT / "examples/run", "circle", "--quick"], cwd=self.dir, capture_output=True, text=True, env=dict(self.environment(), SALTUS="false"))
        self.assertEqual(p.returncode, 1)
        self.assertIn("ended with status 1", p.stderr)
        self.assertEqual(before, (ROOT / "examples/circle/circle.png").read_bytes())


if __name__ == "__main__":
    unittest.main()
