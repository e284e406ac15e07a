"""Pages that are made from the code are up to date, links lead somewhere, and what is to be typed works.

Our own missions are flown by other tests: here one flight, of the quick start's race, stands for theirs, whose commands
are run with --dry-run.
"""

import importlib.util
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from documented import BLOCK, LANGUAGES, LONG, PAGES, REASONS, ROOT, blocks, look_at, run
from mcap.reader import make_reader
from neighbours import installed

from flightapp import app, results
from flightapp.config import Config, load_config
from flightapp.config.document import unit_and_meaning
from flightapp.evaluation.summary import why_failed
from flightapp.recording.document import TOPICS

BLOCKS = [block for page in PAGES for block in blocks(page)]
SHELL = [block for block in BLOCKS if block.language == "sh"]
TUTORIAL = "docs/planner.md"
OURS = {"README.md", "CONTRIBUTING.md", "CHANGELOG.md"}
"""Pages that the site's own check of links doesn't see."""


def generated():
    spec = importlib.util.spec_from_file_location("generated", ROOT / "docs" / "generated.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.PAGES


@pytest.mark.parametrize(("name", "page"), generated().items())
def test_a_page_that_is_made_from_the_code_is_up_to_date(name, page):
    assert (ROOT / "docs" / name).read_text(encoding="utf-8") == page(), "mend with: make docs"


def test_every_field_is_on_the_configuration_s_page_once():
    page = (ROOT / "docs" / "config.md").read_text(encoding="utf-8")
    sections = dict(re.findall(r"^## (\w+)\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL))
    for name, section in Config.model_fields.items():
        keys = re.findall(r"^\| `(\w+)` \|", sections[name], re.MULTILINE)
        assert keys == list(section.annotation.model_fields)


@pytest.mark.parametrize(
    ("description", "unit", "meaning"),
    [
        ("m/s, greatest speed", "m/s", "greatest speed"),
        ("m of line", "m", "of line"),
        ("px: fx, fy", "px", "fx, fy"),
        ("Hz", "Hz", ""),
        ("times that one gate is flown at", "", "times that one gate is flown at"),
        ("socket: from another process", "", "socket: from another process"),
    ],
)
def test_units_are_told_from_words(description, unit, meaning):
    assert unit_and_meaning(description) == (unit, meaning)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A directory with our missions, the race that the quick start has the reader write, and its flight."""
    place = tmp_path_factory.mktemp("reader")
    for name in ("missions", "config"):
        (place / name).symlink_to(ROOT / name)
    for block in blocks("docs/quickstart.md"):
        if block.file:
            (place / block.file).write_text(block.text, encoding="utf-8")
    plan = app.FlightPlan(place / "my_race.py", place / "flown", overrides=("sim.camera=corners",))
    results.finish(app.fly(plan))
    return place


def test_the_quick_start_s_own_race_is_won(flown):
    summary = json.loads((flown / "flown" / "summary.json").read_text(encoding="utf-8"))
    assert not why_failed(summary)
    assert [gate["passed"] for gate in summary["gates"]] == [True, True]


def test_what_a_flight_records_is_on_the_page_of_topics(flown):
    with (flown / "flown" / "flight.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    recorded = {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}
    ours = {topic: schema for topic, schema in recorded.items() if not topic.startswith("/view/")}
    assert len(ours) > 12
    assert ours == {topic: f"flightapp.{TOPICS[topic][0].__name__}" for topic in ours}
    page = (ROOT / "docs" / "topics.md").read_text(encoding="utf-8")
    assert all(f"`{topic}`" in page for topic in recorded)


def test_every_block_says_what_it_is_and_why_it_is_not_run():
    for page in PAGES:
        marks = (ROOT / page).read_text(encoding="utf-8").count("<!-- parsed: ")
        assert marks == sum(bool(block.parsed) for block in blocks(page)), f"{page}: a mark without its block"
    for block in BLOCKS:
        assert block.language in LANGUAGES, f"{block.page}: ```{block.language}"
        assert not block.parsed or block.parsed in REASONS, f"{block.page}: {block.parsed}"


@pytest.mark.parametrize("block", SHELL, ids=lambda block: f"{block.page}: {block.text.splitlines()[0]}")
def test_commands_are_real(block):
    for words in block.commands():
        look_at(words)


RUN = [page for page in PAGES if page != TUTORIAL and any(b.page == page and not b.parsed for b in SHELL)]


@pytest.mark.parametrize("page", RUN)
def test_commands_can_be_typed(page, flown, monkeypatch, capsys):
    """In the order of the page, in one directory."""
    monkeypatch.chdir(flown)
    shutil.rmtree("runs", ignore_errors=True)
    shutil.copytree("flown", "runs/flown")
    for block in blocks(page):
        if block.language != "sh" or block.parsed:
            continue
        for words in block.commands():
            if words[0] == "flightapp" and words[1] not in LONG:
                type_in(words[1:], monkeypatch, capsys)


def globbed(word):
    """What a shell makes of ``word`` in the working directory."""
    found = sorted(map(str, Path().glob(word))) if "*" in word else []
    return found or [word]


def type_in(words, monkeypatch, capsys):
    typed = [found for word in words for found in globbed(word)]
    if words[0] == "fly":
        typed.append("--dry-run")
        if "--out" in words:
            shutil.copytree("flown", words[words.index("--out") + 1])
    if words[:2] == ["plan", "--table"]:
        return  # tests/evaluation/test_plan_table.py makes it, in half a minute
    status, _, error = run(typed, monkeypatch, capsys)
    assert status == 0, f"flightapp {' '.join(words)}: {error}"


def test_the_bring_up_s_files_are_valid(tmp_path):
    files = {b.file or "my.toml": b.text for b in blocks("docs/bringup.md") if b.language in ("toml", "python")}
    (tmp_path / "my.toml").write_text(files["my.toml"], encoding="utf-8")
    config = load_config(tmp_path / "my.toml")
    assert config.link.connection.startswith("serial")
    (tmp_path / "tracks").symlink_to(ROOT / "missions" / "tracks")
    for name, expected in (("hover.toml", ["takeoff", "hover", "land"]), ("missions/turns.py", [])):
        mission = tmp_path / Path(name).name
        mission.write_text(files[name], encoding="utf-8")
        steps, result = app.dry_run(app.FlightPlan(mission, tmp_path / "run", vehicle=tmp_path / "my.toml"))
        assert result.achieved
        assert [step.name for step in steps] == expected


SHORTER = {
    "missions/tracks/five_gates.toml": "missions/tracks/one_gate.toml",
    "race,polynomial,stop_and_go": "stop_and_go",
    "--runs 5": "--runs 1 --workers 1",
    "missions/four_gates.py": "missions/one_gate.py",
}
"""What the tutorial's commands fly for others to save time."""
RUNNER = """
import shlex, sys
from flightapp import cli
if __name__ == "__main__":
    for line in sys.argv[1:]:
        sys.argv = shlex.split(line)
        try:
            cli.main()
        except SystemExit as ended:
            if ended.code:
                raise
"""


def test_the_tutorial_s_planner_is_built_planned_with_flown_and_compared(tmp_path):
    for block in blocks(TUTORIAL):
        if block.file:
            path = tmp_path / block.file
            path.parent.mkdir(exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
    environment = installed(tmp_path / "my-planner", tmp_path / "site")
    for name in ("missions", "config"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "run.py").write_text(RUNNER, encoding="utf-8")
    lines = []
    for block in blocks(TUTORIAL):
        if block.language == "sh" and not block.parsed:
            lines += [line for line in block.text.splitlines() if line.startswith("flightapp ")]
    for old, new in SHORTER.items():
        assert any(old in line for line in lines), f"{old}: not in the tutorial any more"
        lines = [line.replace(old, new) for line in lines]
    done = subprocess.run(
        [sys.executable, "run.py", *lines],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "runs" / "mine" / "report.html").exists()
    assert "stop_and_go" in done.stdout


def anchors(page):
    """The anchors of a page's headings, as GitHub makes them."""
    text = BLOCK.sub("", page.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", sorted(OURS))
def test_links_of_pages_beside_the_site_lead_somewhere(page):
    text = BLOCK.sub("", (ROOT / page).read_text(encoding="utf-8"))
    links = [link for link in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in link]
    assert links or page == "CHANGELOG.md"
    for link in links:
        path, _, anchor = link.partition("#")
        target = ROOT / (path or page)
        assert target.exists(), f"{page}: {link}"
        assert not anchor or anchor in anchors(target), f"{page}: {link}"
