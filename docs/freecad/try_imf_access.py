"""The macro imf_access.py tried as a user runs it, by hand: `IMF=…/imf xvfb-run -a freecad try_imf_access.py`, then look at access.png.

A body with two holes and a tool bit of FreeCAD's own library, both selected, and the macro run from FreeCAD's dialog of macros. It prints
the faces, saves access.png here, and says at the end whether the colours are those of what is reached. As root it takes
QTWEBENGINE_DISABLE_SANDBOX=1, for FreeCAD's start page.
"""

import os
import shutil
import sys
import traceback

import FreeCAD
import FreeCADGui
import Part
from FreeCAD import Vector
from PySide import QtCore, QtGui

HERE = os.path.dirname(os.path.abspath(__file__))
# `Part::Feature`, or with IMF_TRY=PartDesign::Body a body of the workbench Part Design.
KIND = os.environ.get("IMF_TRY", "Part::Feature")
BIT = os.path.join(FreeCAD.getHomePath(), "Mod", "Path", "Tools", "Bit", "5mm_Endmill.fctb")


def scene():
    """A body of 40 × 30 × 20 mm with a hole of 12 mm and one of 4 mm, which the end mill of 5 mm does not enter."""
    from PathScripts import PathToolBit

    document = FreeCAD.newDocument("access")
    body = document.addObject("PartDesign::Body", "Body") if KIND == "PartDesign::Body" else None
    shape = Part.makeBox(40, 30, 20)
    for radius, x in ((6, 12), (2, 29)):
        shape = shape.cut(Part.makeCylinder(radius, 12, Vector(x, 15, 8)))
    solid = document.addObject("Part::Feature", "Block")
    solid.Shape = shape
    if body:
        body.BaseFeature = solid
        solid.ViewObject.Visibility = False
    bit = PathToolBit.Factory.CreateFrom(BIT)
    document.recompute()
    return body or solid, bit


def run_by_dialog():
    """Macro, Macros …, the macro's name, Execute."""
    folder = FreeCAD.ParamGet("User parameter:BaseApp/Preferences/Macro").GetString("MacroPath", FreeCAD.getUserMacroDir(True))
    os.makedirs(folder, exist_ok=True)
    shutil.copy(os.path.join(HERE, "imf_access.py"), os.path.join(folder, "imf_access.FCMacro"))

    def choose():
        dialog = QtGui.QApplication.activeModalWidget()
        tree = dialog.findChild(QtGui.QTreeWidget, "userMacroListBox")
        [item] = tree.findItems("imf_access.FCMacro", QtCore.Qt.MatchExactly, 0)
        tree.setCurrentItem(item)
        dialog.findChild(QtGui.QPushButton, "executeButton").click()

    QtCore.QTimer.singleShot(500, choose)
    FreeCADGui.runCommand("Std_DlgMacroExecute")


def main():
    body, bit = scene()
    view = FreeCADGui.ActiveDocument.ActiveView
    FreeCADGui.Selection.clearSelection()
    FreeCADGui.Selection.addSelection(body)
    FreeCADGui.Selection.addSelection(bit)
    run_by_dialog()
    shares, colours = list(body.ImfReached), list(body.ViewObject.DiffuseColor)
    for index, (share, colour) in enumerate(zip(shares, colours)):
        print("Face%d reached %.3f, colour %.2f %.2f %.2f" % (index + 1, share, *colour[:3]))
    FreeCADGui.Selection.clearSelection()
    bit.ViewObject.Visibility = False
    view.viewIsometric()
    view.fitAll()
    picture = os.path.join(HERE, "access.png")
    view.saveImage(picture, 900, 700, "White")
    faces = body.Shape.Faces
    assert len(colours) == len(faces), "one colour a face"
    for face, share in zip(faces, shares):
        narrow = isinstance(face.Surface, Part.Cylinder) and face.Surface.Radius < 2.5 or face.Area < 13
        assert share < 0.1 if narrow else share > 0.9, (face.Area, share)
    # What is seen: much green, and orange in the narrow hole.
    image = QtGui.QImage(picture)
    seen = [QtGui.QColor(image.pixel(x, y)) for x in range(0, image.width(), 2) for y in range(0, image.height(), 2)]
    green = sum(pixel.green() > pixel.red() + 20 and pixel.green() > pixel.blue() + 20 for pixel in seen)
    orange = sum(pixel.red() > pixel.green() + 40 and pixel.green() > pixel.blue() + 20 for pixel in seen)
    assert green > len(seen) / 10 and orange > 50, (green, orange)
    print("as it should be: %d green pixels, %d orange ones of %d" % (green, orange, len(seen)))


def run():
    try:
        main()
    except Exception:
        traceback.print_exc()
    sys.stdout.flush()
    os._exit(0)


QtCore.QTimer.singleShot(1000, run)
