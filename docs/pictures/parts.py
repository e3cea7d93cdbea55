"""Draws docs/pictures/parts.svg, the parts of RMR: python docs/pictures/parts.py > docs/pictures/parts.svg."""

from rmr_view.svg_picture import SvgPicture, number

BOXES = (
    # x, y, width, height, kind, title, lines
    (20, 20, 190, 64, "file", "program.rmr", ["one program for all robots"]),
    (280, 20, 170, 64, "part", "rmrc", ["compiler: rmr.lang"]),
    (520, 20, 170, 64, "file", "program.rbc", ["the same in every robot"]),
    (740, 20, 140, 64, "file", "lab.yaml", ["floor, robots, faults"]),
    (20, 138, 860, 132, "part", "one robot: rmr.node", ["without I/O and clock: values in, values out"]),
    (20, 338, 400, 122, "part", "rmr up: processes, in real time", []),
    (480, 338, 400, 122, "part", "rmr sim: one process, in virtual time", []),
    (36, 370, 110, 74, "leaf", "rmr_agent", ["a process", "for each robot"]),
    (166, 370, 108, 74, "leaf", "bus", ["zenoh: emulated", "radio and body"]),
    (294, 370, 110, 74, "leaf", "rmr_world", ["physics, sensors,", "lab clock"]),
    (496, 370, 110, 74, "leaf", "all robots", ["the same", "rmr.node"]),
    (626, 370, 108, 74, "leaf", "ether", ["IEEE 802.15.4,", "without delay"]),
    (754, 370, 110, 74, "leaf", "rmr_world", ["the same physics,", "as a library"]),
    (20, 520, 190, 64, "file", "run.mcap", ["inputs of minds, poses, frames"]),
    (280, 520, 134, 64, "leaf", "rmr replay", ["minds anew, checked"]),
    (428, 520, 134, 64, "leaf", "rmr why", ["causes, delays"]),
    (576, 520, 144, 64, "leaf", "rmr view", ["page, Foxglove"]),
    (734, 520, 146, 64, "leaf", "rmr plot", ["pictures, animation"]),
)
CHIPS = ("virtual machine", "coordination", "exchange of facts", "localisation", "navigator", "executive")
"""The parts of a robot."""
ARROWS = (
    # points of a line; the last one has the head
    ((210, 52), (276, 52)),
    ((450, 52), (516, 52)),
    ((605, 84), (605, 134)),
    ((220, 274), (220, 334)),
    ((680, 274), (680, 334)),
    ((810, 84), (810, 110), (895, 110), (895, 400), (884, 400)),
    ((895, 400), (895, 486), (440, 486), (440, 400), (424, 400)),
    ((115, 460), (115, 516)),
    ((520, 460), (520, 498), (180, 498), (180, 516)),
    ((210, 552), (266, 552)),
)
LABELS = ((232, 309, "RadioPort, BodyPort, now"), (692, 309, "RadioPort, BodyPort, now"))
STYLE = """\
.file { fill: #E69F00; fill-opacity: 0.16; stroke: #E69F00; stroke-width: 1.5 }
.part { fill: #0072B2; fill-opacity: 0.10; stroke: #0072B2; stroke-width: 1.5 }
.leaf { fill: #009E73; fill-opacity: 0.14; stroke: #009E73; stroke-width: 1.5 }
.chip { fill: #0072B2; fill-opacity: 0.18 }
.frame { fill: none; stroke-dasharray: 4 4 }
.arrow { fill: none; stroke-width: 1.5 }
.name { font-weight: 600; font-size: 13px }
"""


def picture() -> str:
    """Return the text of the picture."""
    drawing = SvgPicture(910, 604, "The parts of RMR: one robot's mind, its two hosts, what a run leaves", STYLE)
    drawing.add("rect", "frame mid", x=270, y=510, width=620, height=84, rx=8)
    for x, y, width, height, kind, title, lines in BOXES:
        drawing.add("rect", kind, x=x, y=y, width=width, height=height, rx=6)
        centred = kind != "part" or not (width > 300)
        at = x + width / 2 if centred else x + 16
        drawing.words(at, y + (24 if len(lines) > 1 or not centred else 28), title, f"name{' middle' * centred}")
        for place, line in enumerate(lines):
            drawing.words(
                at,
                y + (42 if len(lines) > 1 or not centred else 46) + 15 * place,
                line,
                "soft small" + " middle" * centred,
            )
    for place, chip in enumerate(CHIPS):
        x = 36 + 139 * place
        drawing.add("rect", "chip", x=x, y=206, width=133, height=44, rx=5)
        drawing.words(x + 66.5, 232, chip, "middle")
    for points in ARROWS:
        _arrow(drawing, points)
    for x, y, text in LABELS:
        drawing.words(x, y, text, "soft small")
    return drawing.text()


def _arrow(drawing: SvgPicture, points: tuple[tuple[int, int], ...]) -> None:
    drawing.add("path", "arrow mid", d="M" + "L".join(f"{number(x)} {number(y)}" for x, y in points))
    (ax, ay), (bx, by) = points[-2:]
    dx = (bx > ax) - (bx < ax)
    dy = (by > ay) - (by < ay)
    corners = [(bx - 8 * dx - 4 * dy, by - 8 * dy - 4 * dx), (bx - 8 * dx + 4 * dy, by - 8 * dy + 4 * dx)]
    drawing.add("path", "soft", d=f"M{bx} {by}" + "".join(f"L{x} {y}" for x, y in corners) + "z")


if __name__ == "__main__":
    print(picture(), end="")
