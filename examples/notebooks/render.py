#!/usr/bin/env python3
"""render.py: the notebooks of this folder, with their outputs, as pages of docs/notebooks; pictures are files beside them.

Only the standard library is used. tests/python/test_rendered.py fails where the pages are not those of the notebooks."""
import base64
import html
import json
import os
import pathlib
import re
import sys

HERE = pathlib.Path(__file__).resolve().parent
PAGES = HERE.parents[1] / "docs/notebooks"
PICTURES = {"image/png": "png", "image/svg+xml": "svg"}  # what is shown of an output, the first that there is


def joined(text):
    return text if isinstance(text, str) else "".join(text)


def links(text, names):
    """Links of a notebook, from where its page lies: notebooks are pages there, too."""
    def moved(found):
        target = found[1]
        if re.match(r"https?:|#", target):
            return found[0]
        file, _, part = target.partition("#")
        if file in names:
            file = names[file]
        else:
            file = os.path.relpath(os.path.normpath(HERE / file), PAGES)
        return f"]({file}{'#' + part if part else ''})"
    return re.sub(r"\]\(([^)\s]+)\)", moved, text)


def fenced(text, language):
    fence = "```"
    while fence in text:
        fence += "`"
    return f"{fence}{language}\n{text.rstrip()}\n{fence}"


def blocks(output, name, files):
    """An output as Markdown; its picture is added to `files`."""
    if output["output_type"] == "error":
        sys.exit(f"render.py: {name} has an error in its outputs: run it again")
    if output["output_type"] == "stream":
        return fenced(joined(output["text"]), "text")
    data = output["data"]
    for kind, ending in PICTURES.items():
        if kind in data:
            file = f"{name}-{sum(f.startswith(name + '-') for f in files) + 1}.{ending}"
            text = joined(data[kind])
            files[file] = base64.b64decode(text) if ending == "png" else text.encode()
            return f"![]({file})"
    if "text/html" in data:
        return joined(data["text/html"]).strip()
    return fenced(joined(data["text/plain"]), "text")


def pages():
    """File name to bytes, of every file in docs/notebooks."""
    notebooks = sorted(HERE.glob("*.ipynb"))
    names = {n.name: n.stem + ".md" for n in notebooks}
    files = {}
    for notebook in notebooks:
        cells = json.loads(notebook.read_text("utf-8"))["cells"]
        parts = []
        for i, cell in enumerate(cells):
            source = joined(cell["source"])
            if cell["cell_type"] == "markdown":
                parts.append(links(source, names))
                if i == 0:
                    place = os.path.relpath(notebook, PAGES)
                    parts.append(f"*This page is the notebook [{html.escape(notebook.name)}]({place}), with what it showed when it ran.*")
                continue
            parts.append(fenced(source, "python"))
            previous = None
            for output in cell["outputs"]:
                text = blocks(output, notebook.stem, files)
                if previous and output["output_type"] == "stream" == previous:
                    parts[-1] = parts[-1][:-len("```")] + text[len("```text\n"):]  # streams that were cut by chance
                else:
                    parts.append(text)
                previous = output["output_type"]
        files[names[notebook.name]] = ("\n\n".join(parts) + "\n").encode()
    return files


def write():
    PAGES.mkdir(exist_ok=True)
    made = pages()
    for old in PAGES.iterdir():
        if old.name not in made:
            old.unlink()
    for name, data in made.items():
        (PAGES / name).write_bytes(data)


if __name__ == "__main__":
    write()
