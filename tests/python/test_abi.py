"""What ctypes believes of the library is what the headers say."""
import ctypes
import re

from harness import *
from saltus import _abi, _library

INCLUDE = ROOT / "include"
PUBLIC = ("saltus.h", "job.h", "status.h", "fit.h", "image.h")


class Layout(Case):
    def test_generated(self):
        done = subprocess.run([sys.executable, ROOT / "bindings/python/generate.py", "--print"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        written = (ROOT / "bindings/python/saltus/_abi.py").read_text()
        self.assertEqual(done.stdout, written, "run bindings/python/generate.py")

    def test_members(self):
        """Size and offset of every member, as a C compiler lays them out."""
        structs = {n: s for n, s in vars(_abi).items() if isinstance(s, type) and issubclass(s, ctypes.Structure) and s is not ctypes.Structure}
        self.assertIn("SltJob", structs)
        lines = []
        for name, struct in structs.items():
            lines.append('printf("%s %%zu\\n", sizeof(%s));' % (name, name))
            for member, *_ in struct._fields_:
                lines.append('printf("%s.%s %%zu %%zu\\n", offsetof(%s, %s), sizeof ((%s *)0)->%s);' % (name, member, name, member, name, member))
        source = "#include <stdio.h>\n#include <stddef.h>\n#include <saltus/fit.h>\n#include <saltus/image.h>\nint main(void) {\n%s\nreturn 0;\n}\n" % "\n".join(lines)
        self.put("layout.c", source)
        subprocess.run(["cc", "-I", INCLUDE, "-o", self.path("layout"), self.path("layout.c")], check=True)
        told = subprocess.run([self.path("layout")], capture_output=True, text=True, check=True).stdout
        mine = []
        for name, struct in structs.items():
            mine.append("%s %d" % (name, ctypes.sizeof(struct)))
            for member, *_ in struct._fields_:
                at = getattr(struct, member)
                mine.append("%s.%s %d %d" % (name, member, at.offset, at.size))
        self.assertEqual(mine, told.split("\n")[:-1])

    def test_every_member_is_there(self):
        """Of a struct with a size nothing is left out: its last member ends where it ends, but for padding."""
        for name in _abi.INITIAL:
            last = getattr(name, name._fields_[-1][0])
            self.assertLess(ctypes.sizeof(name) - last.offset - last.size, 8, name.__name__)

    def test_functions(self):
        text = "".join((INCLUDE / "saltus" / header).read_text() for header in PUBLIC)
        text = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
        declared = set(re.findall(r"\b(slt_\w+)\(", text))
        self.assertEqual(declared, set(_abi.FUNCTIONS))

    def test_initial_structs(self):
        """What the _INIT macros make, byte for byte."""
        lines = []
        for struct in _abi.INITIAL:
            macro = "SLT" + re.sub("([A-Z])", r"_\1", struct.__name__[3:]).upper() + "_INIT"
            lines.append("{ %s one; memset(&one, 0, sizeof one); %s made = %s; show(&made, sizeof made); (void)one; }" % (struct.__name__, struct.__name__, macro))
        self.put("initial.c", "#include <stdio.h>\n#include <string.h>\n#include <saltus/fit.h>\n#include <saltus/image.h>\n"
                 "static void show(const void *at, size_t n) { for (size_t i = 0; i < n; i++) printf(\"%%02x\", ((const unsigned char *)at)[i]); puts(\"\"); }\n"
                 "int main(void) { %s return 0; }\n" % "\n".join(lines))
        subprocess.run(["cc", "-O0", "-I", INCLUDE, "-o", self.path("initial"), self.path("initial.c")], check=True)
        told = subprocess.run([self.path("initial")], capture_output=True, text=True, check=True).stdout.split()
        for struct, expected in zip(_abi.INITIAL, told):
            self.assertEqual(bytes(_library.initial(struct)).hex(), expected, struct.__name__)

    def test_version(self):
        project = re.search(r"project\(saltus VERSION ([\d.]+)", (ROOT / "CMakeLists.txt").read_text())[1]
        package = re.search(r'^version = "(.*)"', (ROOT / "bindings/python/pyproject.toml").read_text(), re.M)[1]
        self.assertEqual((package, saltus.__version__), (project, project))

    def test_public_names(self):
        for name in saltus.__all__:
            self.assertTrue(hasattr(saltus, name), name)


class Library(Case):
    def test_missing(self):
        said = self.python("import saltus", env={"SALTUS_LIBRARY": self.path("none.so")}, code=1)
        self.assertIn("ImportError: libsaltus.so.0 was not found", said)
        self.assertIn("SALTUS_LIBRARY", said)
        self.assertIn("none.so", said)

    def test_older(self):
        self.put("old.c", "const char *slt_version(void) { return \"0.0.1\"; }\n")
        subprocess.run(["cc", "-shared", "-fPIC", "-o", self.path("old.so"), self.path("old.c")], check=True)
        said = self.python("import saltus", env={"SALTUS_LIBRARY": self.path("old.so")}, code=1)
        self.assertIn("older than this package", said)

    def test_no_library_at_all(self):
        said = self.python("import saltus", env={"SALTUS_LIBRARY": __file__}, code=1)
        self.assertIn("ImportError", said)
        self.assertIn("test_abi.py", said)

    def test_optimised_python(self):
        self.put("c.salt", CIRCLE)
        out = self.python("import saltus; p = saltus.load('c.salt'); print(p.render(8).shape, list(p.integral(64).gradient))", "-OO")
        self.assertEqual(out, "(8, 8, 1) ['radius', 'centre', 'ink']\n")

    def test_ends_with_programs_alive(self):
        """At the end of the interpreter programs, callbacks and views may still be there."""
        self.put("c.salt", CIRCLE)
        out = self.python("import saltus, threading\np = saltus.load('c.salt')\np.set_print(lambda s: None)\nv = p['centre']\n"
                          "threading.Thread(target=lambda: p.render(8), daemon=True).start()\nprint(p.render(8).shape)")
        self.assertEqual(out, "(8, 8, 1)\n")

    def test_unknown_name(self):
        with self.assertRaisesRegex(AttributeError, "has no attribute 'numbers'"):
            saltus.numbers


if __name__ == "__main__":
    main()
