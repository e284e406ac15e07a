"""Writes the pages that are made from the code, beside this file; `make docs` runs it."""

from pathlib import Path

from flightapp.config.document import document as configuration
from flightapp.recording.document import document as topics
from flightapp.safety.document import document as faults

PAGES = {"config.md": configuration, "faults.md": faults, "topics.md": topics}

if __name__ == "__main__":
    for name, page in PAGES.items():
        Path(__file__).with_name(name).write_text(page(), encoding="utf-8")
