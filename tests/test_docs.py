"""The documents are true: commands, files, and the way CI runs them."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


PAGES = sorted((ROOT / "docs").rglob("*.md"))
COMMANDS = (ROOT / "docs" / "commands.md").read_text()


def commands(page: str = README) -> list[str]:
    blocks = re.findall(r"```(?:sh|bash)\n(.*?)```", page, re.DOTALL)
    return [line.strip() for block in blocks for line in block.splitlines() if line.strip()]


def test_the_two_commands():
    assert "python -m pip install . && startrack optimize" in commands()
    assert "python -m pip install '.[test]' && python -m pytest -n 2" in commands()


def test_ci_runs_the_readmes_test_command():
    """CI takes the line from the README, and runs it as its last step."""
    script = (ROOT / ".ci" / "run").read_text().splitlines()
    assert "tests=$(grep -m 1 'python -m pytest' README.md)" in script
    assert script[-1] == 'eval "$tests"'
    [line] = [line for line in commands() if "pytest" in line]
    assert line == "python -m pip install '.[test]' && python -m pytest -n 2"


def test_every_command_of_the_readme_and_of_the_list_parses():
    import shlex

    from startrack.cli.main import COMMANDS as names
    from startrack.cli.main import _parser, parts_alone

    lines = [line for line in commands() + commands(COMMANDS) if line.startswith("startrack ")]
    every = [parts_alone(shlex.split(line.split("#")[0])[1:]) for line in lines]
    assert {arguments[0] for arguments in every} == set(names)
    for arguments in every:
        _parser(arguments).parse_args(arguments)


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\((?!http)([^)#]+)[^)]*\)", page.read_text()):
        assert (page.parent / link).exists(), link


@pytest.mark.parametrize("block", re.findall(r"```python\n(.*?)```", README, re.DOTALL))
def test_the_readmes_python_runs(block, capsys):
    exec(compile(block, "README.md", "exec"), {})
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_the_pages_name_are_there(page):
    for name in re.findall(
        r"`((?:experiments|startrack|tests|catalogs)/[\w/.-]+)`?", page.read_text()
    ):
        assert (ROOT / name).exists(), name
