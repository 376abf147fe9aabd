"""All small pictures of a folder on one sheet, a row of them for each state. Needs Qt."""
from itertools import groupby
from pathlib import Path

from qtpy.QtCore import Qt
from qtpy.QtGui import QColor, QFont, QImage, QPainter
from qtpy.QtWidgets import QApplication

COLUMNS, WIDE, GAP, TITLE = 2, 780, 12, 22  # columns of states; pixels


def _places(images):
    """Where each image is in a cell of this width, from left to right, from top to bottom."""
    x, y, high, places = 0, TITLE, 0, []
    for image in images:
        if x and x + image.width() > WIDE:
            x, y, high = 0, y + high + GAP, 0
        places.append((x, y))
        x, high = x + image.width() + GAP, max(high, image.height())
    return places, y + high


def _cell(state, pictures):
    """The pictures of one state, its name above."""
    images = [QImage(str(p)) for p in pictures]
    places, high = _places(images)
    cell = QImage(WIDE, high, QImage.Format_RGB32)
    cell.fill(Qt.white)
    paint = QPainter(cell)
    font = QFont("Liberation Sans")
    font.setPixelSize(16)
    font.setBold(True)
    paint.setFont(font)
    paint.drawText(0, 16, state.replace("-", " "))
    for image, place in zip(images, places):
        paint.drawImage(*place, image)
    paint.end()
    return cell


def _order(file):
    """By state; the overview before the station, and that before the rest."""
    state, display = file.name.rsplit("-", 2)[:2]
    return state, display != "Overview", display != "Station", display


def sheet(folder, path):
    """Writes the sheet of folder/NN-state-Display-small.png to `path`."""
    app = QApplication.instance() or QApplication([])
    files = sorted(Path(folder).glob("*-small.png"), key=_order)
    cells = [_cell(state, list(of)) for state, of in
             groupby(files, key=lambda f: f.name.rsplit("-", 2)[0])]
    rows = [cells[i:i + COLUMNS] for i in range(0, len(cells), COLUMNS)]
    out = QImage(GAP + COLUMNS * (WIDE + GAP), GAP + sum(max(c.height() for c in r) + GAP for r in rows),
                 QImage.Format_RGB32)
    out.fill(QColor(255, 255, 255))
    paint = QPainter(out)
    y = GAP
    for row in rows:
        for n, cell in enumerate(row):
            paint.drawImage(GAP + n * (WIDE + GAP), y, cell)
        y += max(c.height() for c in row) + GAP
    paint.end()
    out.save(str(path))
    del app
