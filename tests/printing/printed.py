"""Pages turned back into pixels, from the text of the SVG or PDF alone."""

import re

import numpy as np

NUMBER = r"(-?\d+(?:\.\d+)?)"
_SVG_BOX = re.compile(rf"M{NUMBER} {NUMBER}h{NUMBER}v{NUMBER}h-{NUMBER}z")
_PDF_BOX = re.compile(rf"{NUMBER} {NUMBER} {NUMBER} {NUMBER} re")


def svg_page(text):
    """Width and height in mm, and the black boxes (n, 4) in mm."""
    width, height = re.search(rf'width="{NUMBER}mm" height="{NUMBER}mm" viewBox="0 0 \1 \2"', text).groups()
    paths = re.findall(r'<path fill="#000000" d="([^"]*)"/>', text)
    boxes = [[float(v) for v in box[:4]] for path in paths for box in _SVG_BOX.findall(path)]
    return float(width), float(height), np.array(boxes)


def pdf_pages(data):
    """The same for each page of a PDF, through its transformation from mm to points."""
    text = data.decode("cp1252")
    sizes = re.findall(rf"/MediaBox \[0 0 {NUMBER} {NUMBER}\]", text)
    streams = re.findall(r"stream\n(.*?)\nendstream", text, re.S)
    pages = []
    for (w, h), stream in zip(sizes, streams, strict=True):
        a, _, _, d, _, f = map(
            float, re.match(rf"{NUMBER} {NUMBER} {NUMBER} {NUMBER} {NUMBER} {NUMBER} cm", stream).groups()
        )
        boxes = np.array(
            [
                [float(v) for v in box]
                for line in stream.splitlines()
                if line.startswith("0 g")
                for box in _PDF_BOX.findall(line)
            ]
        )
        mm = 25.4 / 72.0
        low = np.stack((a * boxes[:, 0], f + d * boxes[:, 1]), axis=1)
        boxes = np.column_stack(
            (low[:, 0] * mm, (float(h) - low[:, 1]) * mm, a * boxes[:, 2] * mm, -d * boxes[:, 3] * mm)
        )
        pages.append((float(w) * mm, float(h) * mm, boxes))
    return pages


def picture(width, height, boxes, scale):
    """Grey image at ``scale`` px/mm of a page with black ``boxes`` (n, 4), each pixel by the area that is covered."""
    x = np.arange(int(width * scale) + 1)
    y = np.arange(int(height * scale) + 1)
    covered = np.zeros((len(y), len(x)))
    for bx, by, w, h in boxes * scale:
        columns = slice(max(int(bx), 0), int(bx + w) + 1)
        rows = slice(max(int(by), 0), int(by + h) + 1)
        across = np.minimum(x[columns] + 1, bx + w) - np.maximum(x[columns], bx)
        down = np.minimum(y[rows] + 1, by + h) - np.maximum(y[rows], by)
        covered[rows, columns] += np.outer(np.maximum(down, 0.0), np.maximum(across, 0.0))
    assert covered.max() < 1.001  # nothing is printed twice
    return np.round(255.0 * (1.0 - np.clip(covered, 0.0, 1.0))).astype(np.uint8)
