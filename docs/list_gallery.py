"""The scripts of docs/gallery -> docs/gallery.md: what each does, what it prints, its picture.

python docs/list_gallery.py          (runs them all; pictures go to docs/gallery)
"""

from __future__ import annotations

import ast
import contextlib
import io
import os
import runpy
import shutil
import tempfile
from pathlib import Path

FOLDER = Path(__file__).with_name("gallery")
PAGE = FOLDER.with_suffix(".md")
HEAD = """\
# Gallery
Short scripts, each complete: they run as they stand where startrack is installed. \
`python docs/list_gallery.py` runs them and writes this page.
"""
MOST = 12  # lines of output on the page
LONGEST = 100  # characters of a line


def section(script: Path, output: str, picture: str) -> str:
    """The part of the page of one script; without a picture where the name is empty."""
    code = script.read_text(encoding="utf-8")
    title = (ast.get_docstring(ast.parse(code)) or "").rstrip(".")
    body = code.split('"""\n', 1)[1].strip()
    lines = [line[:LONGEST].rstrip() for line in output.strip().splitlines()]
    shown = "\n".join(lines[:MOST] + ["..."] * (len(lines) > MOST))
    parts = [
        f"## {title}\n[{script.name}](gallery/{script.name})\n",
        f"```python\n{body}\n```\n",
        f"prints\n\n```text\n{shown}\n```\n",
    ]
    if picture:
        parts.append(f"![{title}](gallery/{picture})\n")
    return "\n".join(parts)


def run(script: Path) -> tuple[str, str]:
    """The text that a script prints, and the name of its picture, which is copied beside it."""
    here, said = Path.cwd(), io.StringIO()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            with contextlib.redirect_stdout(said):
                runpy.run_path(str(script), run_name="__main__")
        finally:
            os.chdir(here)
        pictures = sorted(Path(folder).glob("*.png"))
        for picture in pictures:
            shutil.copyfile(picture, FOLDER / picture.name)
    return said.getvalue(), pictures[0].name if pictures else ""


def main() -> None:
    sections = []
    for script in sorted(FOLDER.glob("*.py")):
        print(script.name, flush=True)
        sections.append(section(script, *run(script)))
    PAGE.write_text("\n".join([HEAD, *sections]), encoding="utf-8")
    print(f"wrote {PAGE}")


if __name__ == "__main__":
    os.environ.setdefault("MPLBACKEND", "agg")
    main()
