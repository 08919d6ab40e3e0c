"""The formatter: what it does to lines, and what it never does."""
import re
import subprocess
import tempfile
import unittest
from pathlib import Path

from client import BIN, ROOT, SOURCES, Case

BEFORE = """
import sdf ;
const int  N=3;
param float w[3]={1.0,2.0 , 3.0};   // kept
struct S{
float a;  // first
          // of two
};


float f( float x,float y ){
if(x<y&&!(x>1.0)) return -x*(y- -1.0);
else if (x == y)
return x++;
  else {
  [Disc]if (x<0.0)
      x+=2.0 ;
      // about the loop
for(int i=0;i<N;i++)
{
x = x*float( i )+w [ i ];
}
}



switch (int(x)) {
    case 1: x = 2.0; break;
    default:
    x = 3.0;
}
do { x -= 1.0; } while (x > 0.0);
/* a block
     of comments */
return x>0.0?x :
        y;
}
[Domain(0.0,1.0)]
shader float main(float2 x)
{
	return f(x.x,
	         x.y);   }"""
AFTER = """import sdf;
const int N = 3;
param float w[3] = {1.0, 2.0, 3.0};   // kept
struct S {
    float a;  // first
              // of two
};


float f(float x, float y) {
    if (x < y && !(x > 1.0)) return -x * (y - -1.0);
    else if (x == y)
        return x++;
    else {
        [Disc] if (x < 0.0)
            x += 2.0;
        // about the loop
        for (int i = 0; i < N; i++)
        {
            x = x * float(i) + w[i];
        }
    }


    switch (int(x)) {
    case 1: x = 2.0; break;
    default:
        x = 3.0;
    }
    do { x -= 1.0; } while (x > 0.0);
    /* a block
     of comments */
    return x > 0.0 ? x :
            y;
}
[Domain(0.0, 1.0)]
shader float main(float2 x)
{
    return f(x.x,
             x.y); }
"""


class Format(Case):
    def format(self, text, path="/nowhere/format.salt"):
        uri = self.s.open(path, text)
        edits = self.s.ask("textDocument/formatting", {"textDocument": {"uri": uri}, "options": {"tabSize": 2}})
        self.s.tell("textDocument/didClose", {"textDocument": {"uri": uri}})
        if not edits:
            return text
        self.assertEqual(1, len(edits))
        end = edits[0]["range"]["end"]
        lines = re.split("\r\n|\r|\n", text)
        self.assertEqual((len(lines) - 1, len(lines[-1])), (end["line"], end["character"]))
        return edits[0]["newText"]

    def setUp(self):
        self.s = self.server()

    def test_rules(self):
        self.assertEqual(AFTER, self.format(BEFORE))
        self.assertEqual(AFTER, self.format(AFTER))

    def test_signs_choices_and_statements_on_one_line(self):
        for before, after in [("return - -x - - -y;", "return - -x - - -y;"), ("return + +x+-y;", "return + +x + -y;"), ("x=- --x;", "x = - --x;"), ("return !!(x<y)?-1.0:+1.0;", "return !!(x < y) ? -1.0 : +1.0;"),
                              ("return x<0.0?1.0:x<1.0?y:(float)x;", "return x < 0.0 ? 1.0 : x < 1.0 ? y : (float)x;"), ("if(x<y)return x;", "if (x < y) return x;"), ("if(x<y)++x;else x--;", "if (x < y) ++x; else x--;"),
                              ("for(int i=0;i<3;i++)x+=y;", "for (int i = 0; i < 3; i++) x += y;"), ("switch(1){case 1:x=y;}", "switch (1) { case 1: x = y; }")]:
            wrap = "float f(float x, float y) {\n    %s\n}\n"
            self.assertEqual(wrap % after, self.format(wrap % before))
            self.assertEqual(wrap % after, self.format(wrap % after))

    def test_line_ends_and_marks_stay(self):
        got = self.format("float f(){\r\nreturn 1.0;\r\n}\r\n")
        self.assertEqual("float f() {\r\n    return 1.0;\r\n}\r\n", got)
        self.assertEqual("\ufefffloat f() { return 1.0; }\n", self.format("\ufefffloat f(){ return 1.0; }"))
        self.assertEqual("", self.format(""))
        self.assertEqual("// only this\n", self.format("   // only this"))

    def test_what_has_errors_of_syntax_stays(self):
        for text in ["float f( { return 1.0; }", "float f() { return 1.0 }", "float f() {", "/* open", "\0"]:
            self.assertEqual(text, self.format(text))
        self.assertNotEqual("float f( ) { return y; }\n", self.format("float f( ) { return y; }\n"))  # a wrong name is no matter

    def test_shipped_sources_are_formatted(self):
        for path in SOURCES:
            text = Path(path).read_text()
            self.assertEqual(text, self.format(text, path), path)

    def test_spoiled_sources_come_back(self):
        """Indentation and the blanks between tokens may be lost: what is shipped is what the formatter makes of it."""
        for name in ["circle/circle.salt", "painterly_discs/discs.salt", "csg/csg.salt"]:
            text = (ROOT / "examples" / name).read_text()
            for spoil in (lambda l: l.strip(), lambda l: "\t" + l.strip() if l.strip() else l, lambda l: l.replace(" = ", "=").replace(", ", " ,  ")):
                lines = [l if "//" in l or '"' in l else spoil(l) for l in text.split("\n")]
                goes_on = any(re.match(r"\s+[^\s/].*", l) and not re.search(r"[;{}]\s*(//.*)?$", b) for b, l in zip(text.split("\n"), text.split("\n")[1:]))
                if goes_on and spoil("  a") == "a":
                    continue  # a line that goes on with one above stands where its author put it
                self.assertEqual(text, self.format("\n".join(lines)), name)

    def test_the_command_formats_files(self):
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "a.salt"
            file.write_text(BEFORE)
            done = subprocess.run([BIN, "format", str(file)], capture_output=True, text=True)
            self.assertEqual((0, AFTER, ""), (done.returncode, done.stdout, done.stderr))
            self.assertEqual(BEFORE, file.read_text())
            self.assertEqual(0, subprocess.run([BIN, "format", str(file), "-o", str(file)]).returncode)
            self.assertEqual(AFTER, file.read_text())
            file.write_text("float f( {")
            done = subprocess.run([BIN, "format", str(file), "-o", str(file)], capture_output=True, text=True)
            self.assertEqual((3, ""), (done.returncode, done.stdout))
            self.assertIn("a.salt:1:", done.stderr)
            self.assertEqual("float f( {", file.read_text())
            self.assertEqual(4, subprocess.run([BIN, "format", folder + "/none.salt"], capture_output=True).returncode)

    def test_formatting_changes_no_program(self):
        """Programs of the tests, their blanks spoiled: the same IR before and after."""
        n = 0
        with tempfile.TemporaryDirectory() as folder:
            for path in sorted((ROOT / "tests" / "lang").glob("*.salt"))[::23]:
                text = "\n".join(l if "//" in l or '"' in l else l.strip().replace(" = ", "=").replace(", ", " ,") for l in path.read_text().split("\n"))
                made = self.format(text, str(path))
                self.assertEqual(made, self.format(made, str(path)), path)  # twice is once
                out = []
                for k, source in enumerate((text, made)):
                    file = Path(folder) / f"{k}" / path.name
                    file.parent.mkdir(exist_ok=True)
                    file.write_text(source)
                    done = subprocess.run([BIN, "explain", str(file), "-I", str(path.parent), "--stop-after", "front"], capture_output=True, text=True)
                    out.append((done.returncode, re.sub(r' text ".*"', "", done.stdout)))  # a site's text is that of the source
                self.assertEqual(out[0], out[1], path)
                n += out[0][0] == 0 and made != text
        self.assertGreater(n, 5)


if __name__ == "__main__":
    unittest.main()
