"""What is printed is detected at the size that it states."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from printed import pdf_pages, picture, svg_page
from typer.testing import CliRunner

from flightapp import markers_command
from flightapp.calibration.board import Board, BoardFinder
from flightapp.commands.markers import markers
from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.messages import Frame
from flightapp.perception.aruco import ArucoDetector
from flightapp.printing.page import PAPER, Fill
from flightapp.printing.pdf import pdf
from flightapp.printing.sheets import MARGIN, paper_size
from flightapp.printing.svg import svg
from flightapp.track import Gate, GateShape, Start, Track, load_track

TRACKS = Path(__file__).parents[2] / "missions" / "tracks"


def detector(dictionary, ids):
    layout = GateShape(dictionary=dictionary, layout="top")
    gates = tuple(Gate(id=i, position=(2.0 * i, 0.0, 1.5), yaw_deg=0.0, markers=(m,)) for i, m in enumerate(ids))
    return ArucoDetector(load_config(), Track(name="t", start=Start(position=(0, 0, 0)), gate=layout, gates=gates))


def sizes(image, dictionary, ids, scale):
    """Each marker's sides (4,) in mm, and its corners (4, 2) in mm on the page."""
    found = detector(dictionary, ids).detect(Frame(0.0, 0, image), None)
    corners = {marker.marker_id: (marker.corners + 0.5) / scale for marker in found}
    sides = {key: np.linalg.norm(quad - np.roll(quad, 1, axis=0), axis=1) for key, quad in corners.items()}
    return sides, corners


@pytest.mark.parametrize(
    ("dictionary", "size", "ids"),
    [
        ("4X4_50", 60.0, "0-7"),
        ("APRILTAG_36h11", 40.0, "5,580"),
        ("7X7_1000", 150.0, "999"),
        ("5X5_250", 24.0, "100-110"),
    ],
)
def test_printed_markers_are_detected_at_their_size(dictionary, size, ids):
    wanted = markers_command.parse_ids(ids)
    pages = markers_command.id_pages(wanted, dictionary, size, "A4", tile=False)
    scale = 400.0 / size if size > 60.0 else 5.0
    seen = []
    for page in pages:
        from_svg, from_pdf = svg_page(svg(page)), pdf_pages(pdf([page]))[0]
        np.testing.assert_allclose(from_pdf[:2], from_svg[:2], atol=1e-3)
        for width, height, boxes in (from_svg, from_pdf):
            sides, corners = sizes(picture(width, height, boxes, scale), dictionary, wanted, scale)
            for key, lengths in sides.items():
                np.testing.assert_allclose(lengths, size, atol=0.25 / scale + 1e-3 * size)
                across = corners[key][1] - corners[key][0]
                assert across[0] > 0.99 * size  # its top is up
        seen += sides
    assert sorted(seen) == sorted(wanted)


def test_the_five_gates_markers_and_drawings():
    track = load_track(TRACKS / "five_gates.toml")
    pages = markers_command.track_pages(track, "A2", tile=False)
    count = len(track.gates)
    for gate, page in zip(track.gates, pages[:count], strict=True):
        width, height, boxes = svg_page(svg(page))
        _, corners = sizes(picture(width, height, boxes, 3.0), track.gate.dictionary, gate.markers, 3.0)
        quads = np.array([corners[marker] for marker in gate.markers])
        wanted = track.gate.marker_corners()[:, :, 1:] * (-1.0, -1.0)  # right and down on the page
        scale = np.ptp(quads[:, :, 0]) / np.ptp(wanted[:, :, 0])
        placed = (quads - quads.mean(axis=(0, 1))) / scale
        np.testing.assert_allclose(placed, wanted, atol=0.004)
    found = {}
    for page in pages[count:]:
        sides, _ = sizes(picture(*svg_page(svg(page)), 1.0), track.gate.dictionary, range(20), 1.0)
        found |= sides
    assert sorted(found) == sorted(marker for gate in track.gates for marker in gate.markers)
    np.testing.assert_allclose(list(found.values()), 1e3 * track.gate.marker_size, rtol=1e-3)


def test_parts_of_a_marker_make_it_up_again():
    pages = markers_command.id_pages((3,), "4X4_50", 300.0, "A4", tile=True)
    assert len(pages) > 1
    cut = 2.5
    whole = np.full((800, 800), 255, np.uint8)
    windows = {}
    for page in pages:
        words = next(shape.text for shape in page.shapes if "row" in getattr(shape, "text", ""))
        row, column = (int(words.split(key)[1].split()[0].strip(",")) - 1 for key in ("row ", "column "))
        lines = [
            shape for shape in page.shapes if hasattr(shape, "x1") and shape.x1 == MARGIN + cut and shape.x2 < shape.x1
        ]
        windows[row, column] = page, max(line.y1 for line in lines) - MARGIN - cut
    rows, columns = (max(key[i] for key in windows) + 1 for i in (0, 1))
    width, height = (400.0 + 10.0 * (columns - 1)) / columns, (400.0 + 10.0 * (rows - 1)) / rows
    for (row, column), (page, tall) in windows.items():
        assert tall == pytest.approx(height)
        boxes = np.array([b for s in page.shapes if isinstance(s, Fill) for b in s.boxes])
        part = picture(page.width, page.height, boxes - (MARGIN + cut, MARGIN + cut, 0, 0), 2.0)
        x, y = round(2.0 * column * (width - 10.0)), round(2.0 * row * (height - 10.0))
        inside = part[: min(round(2 * height), 800 - y), : min(round(2 * width), 800 - x)]
        target = whole[y : y + inside.shape[0], x : x + inside.shape[1]]
        np.minimum(target, inside[: target.shape[0], : target.shape[1]], out=target)
    sides, _ = sizes(whole, "4X4_50", (3,), 2.0)
    np.testing.assert_allclose(sides[3], 300.0, atol=1.0)


def test_the_board_is_detected_at_its_size():
    board = Board()
    pages = markers_command.board_pages(board, "A4", tile=False)
    assert len(pages) == 1
    view = BoardFinder(board).find(picture(*svg_page(svg(pages[0])), 5.0))
    assert len(view.ids) == len(board.corners)
    printed = view.pixels / 5.0
    wanted = 1e3 * board.corners[view.ids, :2]
    np.testing.assert_allclose(printed - printed.mean(axis=0), wanted - wanted.mean(axis=0), atol=0.06)


@settings(max_examples=15)
@given(
    st.sampled_from(["4X4_50", "6X6_250", "ARUCO_MIP_36h12"]),
    st.floats(5.0, 600.0),
    st.lists(st.integers(0, 49), min_size=1, max_size=12, unique=True),
    st.sampled_from([*PAPER, "300x500"]),
    st.booleans(),
)
def test_everything_stays_on_the_paper_and_apart(dictionary, size, ids, page, tile):
    try:
        pages = markers_command.id_pages(ids, dictionary, size, page, tile)
    except BadInputError as error:
        assert not tile
        assert "--tile" in str(error)
        return
    assert pdf(pages) == pdf(markers_command.id_pages(ids, dictionary, size, page, tile))
    for sheet in pages:
        assert sorted((sheet.width, sheet.height)) == pytest.approx(sorted(paper_size(page)))
        fills = [shape for shape in sheet.shapes if isinstance(shape, Fill)]
        outlines = []
        for fill in fills:
            boxes = np.array(fill.boxes)
            low, high = boxes[:, :2].min(axis=0), (boxes[:, :2] + boxes[:, 2:]).max(axis=0)
            assert (low >= MARGIN - 1e-6).all()
            assert (high <= (sheet.width - MARGIN + 1e-6, sheet.height - MARGIN + 1e-6)).all()
            outlines.append((low, high))
        for i, (low, high) in enumerate(outlines):
            for low_2, high_2 in outlines[:i]:
                assert not ((low < high_2 - 1e-6) & (low_2 < high - 1e-6)).all()


def test_bad_input_says_how_to_mend_it(tmp_path):
    for call, words in (
        (lambda: markers_command.id_pages((3,), "4X4_50", 300.0, "A4", False), "--page A2"),
        (lambda: markers_command.id_pages((50,), "4X4_50", 30.0, "A4", False), "0 to 49"),
        (lambda: markers_command.id_pages((1,), "4X5_50", 30.0, "A4", False), "no marker dictionary"),
        (lambda: markers_command.id_pages((1,), "4X4_50", 30.0, "B9", False), "WIDTHxHEIGHT"),
        (lambda: markers_command.id_pages((1,), "4X4_50", math.nan, "A4", False), "2 to 2000"),
        (lambda: markers_command.parse_ids("3-1"), "0-3,7"),
        (lambda: markers_command.track_pages(load_track(TRACKS / "lemniscate.toml"), "A4", False), "no gates"),
        (lambda: markers_command.write_pages([], tmp_path / "x.png"), ".pdf or .svg"),
        (lambda: Board(dictionary="4X4_50", columns=20, rows=20), "200 markers"),
        (lambda: Board(marker=0.03), "smaller than its squares"),
    ):
        with pytest.raises(BadInputError, match=words.replace(".", r"\.")):
            call()


def test_the_commands_write_their_files(tmp_path):
    runner = CliRunner()
    for arguments, files in (
        (["track", str(TRACKS / "four_gates.toml"), "--page", "A2", "--out", str(tmp_path / "g.pdf")], ["g.pdf"]),
        (["ids", "0-7", "--size", "60", "--out", str(tmp_path / "i.svg")], ["i-1.svg", "i-2.svg"]),
        (
            ["board", "--page", "Letter", "--square", "22", "--marker", "16", "--out", str(tmp_path / "b.svg")],
            ["b.svg"],
        ),
    ):
        result = runner.invoke(markers, arguments)
        assert result.exit_code == 0, result.output
        assert all((tmp_path / name).stat().st_size > 1000 for name in files)
