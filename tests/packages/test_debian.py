"""What debian/ says agrees with the tree: nothing is built here, and no tool of Debian's is wanted.

    SALTUS_BUILD=build tests/packages/test_debian.py        BLESS=1 writes debian/libsaltus0.symbols
"""
import fnmatch
import os
import pathlib
import re
import subprocess
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
DEBIAN = ROOT / "debian"
BUILD = pathlib.Path(os.environ["SALTUS_BUILD"])
ARCH = "x86_64-linux-gnu"  # stands for any


def cache(name):
    return re.search(rf"^{name}:\w+=(.*)$", (BUILD / "CMakeCache.txt").read_text(), re.M).group(1)


def stanzas():
    """Paragraphs of debian/control as dictionaries; the first is that of the source."""
    out = []
    for text in (DEBIAN / "control").read_text().strip().split("\n\n"):
        out.append({key: " ".join(value.split()) for key, value in re.findall(r"^([\w-]+):((?:.*\n?)(?:^[ \t].*\n?)*)", text, re.M)})
    return out


def binaries():
    return {s["Package"]: s for s in stanzas()[1:]}


def names(field):
    return re.findall(r"(?:^|[,|])\s*([a-z0-9][a-z0-9.+-]*)", field)


def exported():
    listed = subprocess.run(["nm", "-D", "--defined-only", BUILD / "libsaltus.so"], capture_output=True, text=True, check=True).stdout
    return sorted(line.split()[2].split("@")[0] for line in listed.splitlines())


def in_package(path):
    """Where debian/rules has the build put what `cmake --install` puts at `path`."""
    path = re.sub(r"^usr/lib/(?!python)", f"usr/lib/{ARCH}/", path)
    return path.replace("usr/share/saltus/stdlib", f"usr/share/{library()}/stdlib")


def soname():
    said = subprocess.run(["readelf", "-d", BUILD / "libsaltus.so"], capture_output=True, text=True, check=True).stdout
    return re.search(r"soname: \[(.*?)\]", said).group(1)


def library():
    return re.sub(r"\.so\.", "", soname())


class Debian(unittest.TestCase):
    def test_versions_are_those_of_the_project(self):
        version = cache("CMAKE_PROJECT_VERSION")
        self.assertEqual(re.match(r"saltus \((.*?)\)", (DEBIAN / "changelog").read_text()).group(1), version)
        self.assertEqual(re.search(r'^version = "(.*)"', (ROOT / "bindings/python/pyproject.toml").read_text(), re.M).group(1), version)

    def test_packages_are_consistent(self):
        packages = binaries()
        self.assertIn(library(), packages, "the package of the library has the number of its SONAME")
        self.assertIn(f"libllvm{cache('SALTUS_LLVM')}", names(packages[library()]["Depends"]), "the library loads the LLVM that it was built for")
        self.assertIn(f"share/{library()}/stdlib", (DEBIAN / "rules").read_text())
        for path in DEBIAN.glob("*.*"):
            if path.suffix in (".install", ".symbols", ".examples"):
                self.assertIn(path.stem, packages, f"{path.name} is of no package")
        for name in packages:
            self.assertTrue(any((DEBIAN / f"{name}.{kind}").exists() for kind in ("install", "examples")), f"{name} has no files")

    def test_what_a_build_wants_is_in_bootstrap(self):
        lists = dict(re.findall(r"^(\w+)=\(([^)]*)\)", (ROOT / "bootstrap").read_text(), re.M))
        have = set(lists["packages"].split()) | set(lists["packaging"].split()) | {"debhelper-compat", "dh-sequence-python3"}  # other names of debhelper and dh-python
        self.assertEqual(set(names(stanzas()[0]["Build-Depends"])) - have, set())
        self.assertIn(f"llvm-{cache('SALTUS_LLVM')}-dev", names(stanzas()[0]["Build-Depends"]))

    def test_every_installed_file_is_of_one_package(self):
        with tempfile.TemporaryDirectory() as scratch:
            subprocess.run(["cmake", "--install", BUILD, "--prefix", "/usr"], env={**os.environ, "DESTDIR": scratch}, check=True, stdout=subprocess.DEVNULL)
            files = [in_package(str(p.relative_to(scratch))) for p in pathlib.Path(scratch).rglob("*") if not p.is_dir()]
        files = [f for f in files if not f.startswith("usr/lib/python")]  # debian/rules has pybuild install these
        files = [f for f in files if not fnmatch.fnmatch(f, "*/libLLVM-*-saltus-*.so")]  # it leaves this out
        self.assertIn("-DSALTUS_LLVM_LINKED=OFF", (DEBIAN / "rules").read_text())
        self.assertGreater(len(files), 40)
        owners = {f: [] for f in files}
        lists = [(p.stem, line.split()[0]) for p in DEBIAN.glob("*.install") for line in p.read_text().splitlines()]
        lists += [("not-installed", line) for line in (DEBIAN / "not-installed").read_text().splitlines()]
        for owner, pattern in lists:
            if owner == "python3-saltus":
                continue
            found = [f for f in files if fnmatch.fnmatch(f, pattern) or fnmatch.fnmatch(f, pattern + "/*")]
            self.assertTrue(found, f"debian/{owner}: nothing is installed as {pattern}")
            for f in found:
                owners[f].append(owner)
        for f, of in owners.items():
            self.assertEqual(len(of), 1, f"{f} is of {of or 'no package: name it in a debian/*.install'}")

    def test_symbols_are_those_of_the_library(self):
        path = DEBIAN / f"{library()}.symbols"
        lines = path.read_text().splitlines() if path.exists() else []
        since = {line.split("@")[0].strip(): line.split()[1] for line in lines if line.startswith(" ")}
        want = exported()
        text = f"{soname()} {library()} #MINVER#\n* Build-Depends-Package: libsaltus-dev\n" + "".join(f" {s}@Base {since.get(s, cache('CMAKE_PROJECT_VERSION'))}\n" for s in want)
        gone = sorted(set(since) - set(want))
        if os.environ.get("BLESS"):
            path.write_text(text)
        else:
            self.assertEqual(gone, [], "functions that programs out there may call")
            self.assertEqual(path.read_text(), text, "BLESS=1 writes it")

    def test_photographs_have_their_author(self):
        text = (DEBIAN / "copyright").read_text()
        for note in (ROOT / "examples").glob("*/PHOTO.txt"):
            photo = str((note.parent / "photo.png").relative_to(ROOT))
            paragraph = next((p for p in text.split("\n\n") if photo in p), None)
            self.assertIsNotNone(paragraph, f"debian/copyright does not name {photo}")
            author = re.search(r"photograph by ([\w ]+)", note.read_text()).group(1)
            self.assertIn(author, paragraph)


if __name__ == "__main__":
    unittest.main()
