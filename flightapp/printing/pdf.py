"""Pages as PDF 1.4 (ISO 32000-1): filled rectangles, lines, and text in Helvetica, which every reader has.

It asks the reader to print at actual size (ViewerPreferences, PrintScaling).
"""

from collections.abc import Sequence

from flightapp.printing.page import Fill, Line, Page, Shape, Text
from flightapp.printing.svg import number

POINT = 72.0 / 25.4
"""Of a millimetre."""
_ASCII = (
    "278 278 355 556 556 889 667 191 333 333 389 584 278 333 278 278 556 556 556 556 556 556 556 556 556 556 278 278"
    " 584 584 584 556 1015 667 667 722 722 667 611 778 722 278 500 667 556 833 722 778 667 778 722 667 611 722 667 944"
    " 667 667 611 278 278 278 469 556 333 556 556 500 556 556 278 556 556 222 222 500 222 833 556 556 556 556 333 500"
    " 278 556 500 722 500 500 500 334 260 334 584"
)
WIDTHS = {chr(32 + i): int(width) for i, width in enumerate(_ASCII.split())}
"""Of Helvetica's characters, in thousandths of its size (Adobe Core 14 AFM)."""


def pdf(pages: Sequence[Page]) -> bytes:
    """The whole document; the same pages give the same bytes."""
    first = 4
    kids = " ".join(f"{first + 2 * i} 0 R" for i in range(len(pages)))
    bodies = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        f"<< /Type /Pages /Kids [{kids}] /Count {len(pages)} >>".encode(),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
    ]
    for i, page in enumerate(pages):
        size = f"{number(page.width * POINT)} {number(page.height * POINT)}"
        bodies.append(
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {size}] /Contents {first + 2 * i + 1} 0 R"
            " /Resources << /Font << /F1 3 0 R >> >> >>".encode()
        )
        content = _content(page)
        bodies.append(f"<< /Length {len(content)} >>\nstream\n".encode() + content + b"\nendstream")
    return _document(bodies)


def _document(bodies: Sequence[bytes]) -> bytes:
    out, offsets = bytearray(b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n"), []
    for count, body in enumerate(bodies, start=1):
        offsets.append(len(out))
        out += f"{count} 0 obj\n".encode() + body + b"\nendobj\n"
    table = len(out)
    out += f"xref\n0 {len(bodies) + 1}\n0000000000 65535 f \n".encode()
    out += b"".join(f"{offset:010d} 00000 n \n".encode() for offset in offsets)
    out += f"trailer\n<< /Size {len(bodies) + 1} /Root 1 0 R >>\nstartxref\n{table}\n%%EOF\n".encode()
    return bytes(out)


def _content(page: Page) -> bytes:
    """Drawing operators; the first turns the axes to millimetres from the top left."""
    axes = f"{POINT:.9f} 0 0 {-POINT:.9f} 0 {number(page.height * POINT)} cm"
    return "\n".join([axes, *map(_operators, page.shapes)]).encode("cp1252", "replace")


def _operators(shape: Shape) -> str:
    match shape:
        case Fill():
            boxes = " ".join(f"{' '.join(map(number, box))} re" for box in shape.boxes)
            return f"{number(shape.grey)} g {boxes} f"
        case Line():
            ends = f"{number(shape.x1)} {number(shape.y1)} m {number(shape.x2)} {number(shape.y2)} l"
            return f"0 G {number(shape.width)} w {'[2 1] 0 d' if shape.dashed else '[] 0 d'} {ends} S"
        case Text():
            x = shape.x - 0.5 * text_width(shape) if shape.middle else shape.x
            words = shape.text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
            place = f"1 0 0 -1 {number(x)} {number(shape.y)} Tm"
            return f"BT {number(shape.grey)} g /F1 {number(shape.size)} Tf {place} ({words}) Tj ET"


def text_width(text: Text) -> float:
    """mm."""
    return text.size * sum(WIDTHS.get(letter, 556) for letter in text.text) / 1000.0
