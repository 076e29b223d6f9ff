"""Pictures of the help in QGIS's dialogs: parts of the pages' pictures, and a drawing, as wide as its pane.

``python docs/make_help_pictures.py`` writes ``plugin/pictures`` from ``docs/pictures``; it belongs after
``make_screenshots.py`` and ``make_report_pictures.py``. The pane is 240 pixels wide when a dialog opens.
Parts are cut out in their own size, so that texts in them stay legible.
"""

from __future__ import annotations

import sys
from pathlib import Path

from PIL import Image
from PyQt5.QtCore import QByteArray
from PyQt5.QtGui import QGuiApplication, QImage, QPainter
from PyQt5.QtSvg import QSvgRenderer

REPOSITORY = Path(__file__).resolve().parents[1]
SOURCES, TARGETS = REPOSITORY / "docs" / "pictures", REPOSITORY / "plugin" / "pictures"
WIDTH_PX, GAP_PX, COLOURS = 232, 4, 256
#: By picture: its source, and the parts (left, top, width, height) side by side in rows.
PARTS = {
    "residuals.png": ("qgis_residuals.png", [[(590, 306, 232, 156)], [(84, 609, 209, 60)]]),
    "registration.png": ("report_registration.png", [[(260, 560, 114, 170), (860, 560, 114, 170)]]),
    "measuring.png": ("qgis_panel.png", [[(625, 440, 232, 150)]]),
    "tie.png": ("qgis_ties_dark.png", [[(640, 430, 114, 170), (1006, 430, 114, 170)]]),
}
#: Leave-one-out: the point of two images, where the third sees it, and where it was measured there.
LEAVE_ONE_OUT = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 232 190"
font-family="DejaVu Sans" font-size="11"><rect width="232" height="190" fill="#ffffff"/>
<path d="M0 166 C45 154 80 176 120 164 S200 158 232 168 V190 H0 Z" fill="#dfe5dc" stroke="#7c8a78"/>
<g fill="#eef1f6" stroke="#3c4a5c"><path d="M6 44 L60 32 L66 43 L12 56 Z"/><path d="M84 30 H146 V43 H84 Z"/>
<path d="M172 32 L226 44 L220 56 L166 43 Z"/></g>
<g stroke="#1f5fa8" stroke-width="1.5"><path d="M36 44 L115 164"/><path d="M115 37 L115 164"/></g>
<path d="M115 164 L188 43" stroke="#b06a00" stroke-width="1.5" stroke-dasharray="5 3"/>
<circle cx="115" cy="164" r="4.5" fill="#1f5fa8"/>
<g fill="#1f5fa8"><circle cx="36" cy="44" r="3"/><circle cx="115" cy="37" r="3"/></g>
<circle cx="188" cy="42" r="4.5" fill="none" stroke="#b06a00" stroke-width="1.8"/>
<path d="M192 43 L206 46" stroke="#c01818" stroke-width="2"/><circle cx="208" cy="46.5" r="3" fill="#1f5fa8"/>
<g fill="#1c2430"><text x="8" y="22">image 1</text><text x="92" y="22">image 2</text>
<text x="172" y="22">left out</text>
<text x="4" y="118">intersection</text><text x="4" y="132">of 1 and 2</text>
<text font-size="10" x="177" y="87" fill="#8a5200">predicted</text>
<text font-size="10" x="177" y="72" fill="#1f5fa8">measured</text>
<text font-size="10" x="177" y="102" fill="#c01818">red: error</text></g></svg>"""


def main() -> int:
    """Write all pictures."""
    TARGETS.mkdir(exist_ok=True)
    for name, (source, rows) in PARTS.items():
        with Image.open(SOURCES / source) as picture:
            save(lay_out(picture.convert("RGB"), rows), TARGETS / name)
    application = QGuiApplication([sys.argv[0], "-platform", "offscreen"])
    drawing = QImage(WIDTH_PX, 190, QImage.Format_RGB32)
    painter = QPainter(drawing)
    painter.setRenderHint(QPainter.Antialiasing)
    QSvgRenderer(QByteArray(LEAVE_ONE_OUT.encode())).render(painter)
    painter.end()
    del application
    target = TARGETS / "leave_one_out.png"
    drawing.save(str(target))
    with Image.open(target) as picture:
        save(picture.convert("RGB"), target)
    return 0


def lay_out(picture: Image.Image, rows: list[list[tuple[int, int, int, int]]]) -> Image.Image:
    """Return parts of a picture, side by side in rows."""
    heights = [max(part[3] for part in row) for row in rows]
    made = Image.new("RGB", (WIDTH_PX, sum(heights)), "white")
    top = 0
    for row, height in zip(rows, heights, strict=True):
        left = 0
        for x, y, wide, high in row:
            made.paste(picture.crop((x, y, x + wide, y + high)), (left, top))
            left += wide + GAP_PX
        top += height
    return made


def save(picture: Image.Image, target: Path) -> None:
    """Write a picture with few colours of its own, a third of the bytes."""
    picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(target, optimize=True)
    print(f"{target.relative_to(REPOSITORY)}: {target.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    sys.exit(main())
