"""A page as SVG, whose user unit is the millimetre."""

from xml.sax.saxutils import escape

from flightapp.printing.page import Fill, Line, Page, Shape, Text

FONT = "Helvetica, Arial, sans-serif"


def svg(page: Page) -> str:
    """The whole document; the same page gives the same text."""
    width, height = number(page.width), number(page.height)
    lines = [
        '<svg xmlns="http://www.w3.org/2000/svg"'
        f' width="{width}mm" height="{height}mm" viewBox="0 0 {width} {height}">',
        f'<path fill="#ffffff" d="M0 0h{width}v{height}h-{width}z"/>',
        *map(_element, page.shapes),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def number(value: float) -> str:
    """``value`` in mm to a tenth of a micrometre, without what is not needed."""
    return f"{round(value, 4) + 0.0:.4f}".rstrip("0").rstrip(".")


def _grey(level: float) -> str:
    return f"#{round(255 * level):02x}" + 2 * f"{round(255 * level):02x}"


def _element(shape: Shape) -> str:
    match shape:
        case Fill():
            path = "".join(
                f"M{number(x)} {number(y)}h{number(w)}v{number(h)}h-{number(w)}z" for x, y, w, h in shape.boxes
            )
            return f'<path fill="{_grey(shape.grey)}" d="{path}"/>'
        case Line():
            ends = " ".join(f'{key}="{number(getattr(shape, key))}"' for key in ("x1", "y1", "x2", "y2"))
            dash = ' stroke-dasharray="2 1"' if shape.dashed else ""
            return f'<line {ends} stroke="#000000" stroke-width="{number(shape.width)}"{dash}/>'
        case Text():
            anchor = ' text-anchor="middle"' if shape.middle else ""
            place = f'x="{number(shape.x)}" y="{number(shape.y)}" font-size="{number(shape.size)}"'
            return f'<text {place} fill="{_grey(shape.grey)}" font-family="{FONT}"{anchor}>{escape(shape.text)}</text>'
