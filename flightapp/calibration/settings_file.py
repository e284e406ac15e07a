"""What a calibration found, written into a vehicle file that keeps all else as it is, comments too."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.perception.camera import CameraModel


def camera_settings(model: CameraModel) -> dict[str, Any]:
    """The intrinsics of ``model`` as the camera section has them."""
    return {
        "lens": model.lens.value,
        "width": model.width,
        "height": model.height,
        "focal": [round(float(value), 4) for value in model.focal],
        "distortion": [round(float(value), 7) for value in model.distortion],
    }


def with_settings(text: str, section: str, settings: Mapping[str, Any], comment: str, source: str) -> str:
    """TOML ``text`` with ``settings`` in ``section`` and a ``comment`` on the first; raises `BadInputError`.

    ``source`` says where the text is from.
    """
    try:
        document = tomlkit.parse(text)
    except TOMLKitError as error:
        raise BadInputError(f"{source}: not valid TOML: {error}") from None
    table = document.get(section)
    if table is None:
        table = tomlkit.table()
        if document:
            document.add(tomlkit.nl())
        document.add(section, table)
    if not isinstance(table, dict):
        raise BadInputError(f"{source}: '{section}' must be a table, [{section}]")
    for i, (key, value) in enumerate(settings.items()):
        item: Any = tomlkit.item(value)
        before = table.get(key)
        if i == 0 and comment:
            item.comment(comment)
        elif before is not None and getattr(before, "trivia", None) is not None:
            item.trivia.comment_ws, item.trivia.comment = before.trivia.comment_ws, before.trivia.comment
        table[key] = item
    return tomlkit.dumps(document)


def write_settings(out: Path, vehicle: Path | None, section: str, settings: Mapping[str, Any], comment: str) -> None:
    """Write the file ``vehicle`` with ``settings`` to ``out``, and read it back; raises `BadInputError`."""
    try:
        text = vehicle.read_text(encoding="utf-8") if vehicle is not None else ""
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(f"{vehicle}: cannot be read: {error}") from None
    changed = with_settings(text, section, settings, comment, str(vehicle))
    try:
        out.write_text(changed, encoding="utf-8")
    except OSError as error:
        raise BadInputError(f"--out {out}: cannot be written: {error.strerror or error}") from None
    load_config(out)
