"""A FreeCAD macro: which faces of a body a tool reaches, by `imf access`.

In FreeCAD: copy this file into the macro folder as `imf_access.FCMacro`, select a body and, if there is one, a tool bit of the CAM
workbench, and run it. Without a tool bit it asks for a tool file. Every face gets a colour, from orange (not reached) to green (reached),
and the body the property `ImfReached`: the share of each face's area that is reached.

Without a window: `IMF_PART=part.step IMF_TOOL=mill.toml freecadcmd imf_access.py`, the part a file that FreeCAD opens, with `IMF_PITCH`
the edge of a voxel in millimetres and IMF_BODY the name of a body in a document of several. It prints the shares.

The command `imf` is looked for on the PATH, or where the environment variable IMF says.
"""

import json
import os
import shutil
import subprocess
import tempfile

import FreeCAD
import Part

# Largest distance between the mesh and the faces, in millimetres.
DEFLECTION = 0.05
RESULT = "ImfReached"


def is_bit(own):
    """A tool bit of the CAM (Path) workbench: its shape has a name."""
    return any(hasattr(own, name) for name in ("BitShape", "ShapeName", "ShapeType"))


def bit_text(bit):
    """A tool bit as FreeCAD saves it (.fctb), lengths in millimetres; imf knows which shapes it reads."""
    shape = next(str(getattr(bit, name)) for name in ("BitShape", "ShapeName", "ShapeType") if hasattr(bit, name))
    names = getattr(bit, "BitPropertyNames", bit.PropertiesList)
    values = {name: str(getattr(bit, name)) for name in names if hasattr(getattr(bit, name), "Unit")}
    return json.dumps({"version": 2, "name": bit.Label, "shape": os.path.basename(shape), "parameter": values})


def mesh_of(shape):
    """Corners of triangles, and the face that each belongs to. Faces share their edges' points."""
    corners, triangles, faces, known = [], [], [], {}
    # Of the whole at first, so that neighbouring faces have the same points on their edges.
    shape.tessellate(DEFLECTION)
    for index, face in enumerate(shape.Faces):
        points, own = face.tessellate(DEFLECTION)
        places = []
        for point in points:
            key = (round(point.x, 6), round(point.y, 6), round(point.z, 6))
            if key not in known:
                known[key] = len(corners)
                corners.append(key)
            places.append(known[key])
        for triangle in own:
            a, b, c = (places[corner] for corner in triangle)
            if a != b and b != c and c != a:
                triangles.append((a, b, c))
                faces.append(index)
    return corners, triangles, faces


def write_obj(path, corners, triangles):
    """A mesh in millimetres, as FreeCAD has all lengths."""
    with open(path, "w") as file:
        for corner in corners:
            file.write("v %.9g %.9g %.9g\n" % corner)
        for triangle in triangles:
            file.write("f %d %d %d\n" % tuple(place + 1 for place in triangle))


def read_ply(path):
    """Corners of the surface's triangles, three a triangle, and their verdicts (0 is reached)."""
    import numpy

    with open(path, "rb") as file:
        head, names, count = b"", [], 0
        while not head.endswith(b"end_header\n"):
            line = file.readline()
            head += line
            words = line.decode("ascii").split()
            if words[:2] == ["element", "vertex"]:
                count = int(words[2])
            elif words[:1] == ["element"]:
                names.append(None)
            elif words[:1] == ["property"] and None not in names and words[1] != "list":
                names.append((words[2], {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4"}[words[1]]))
        rows = numpy.frombuffer(file.read(), dtype=numpy.dtype([name for name in names if name]), count=count)
    points = numpy.stack([rows["x"], rows["y"], rows["z"]], axis=1).astype(float)
    return points.reshape(-1, 3, 3), rows["verdict"].reshape(-1, 3)[:, 0]


def shares(corners, triangles, faces, count, ply):
    """The share of each face that is reached: every small triangle belongs to the face in one of whose triangles its middle lies."""
    import numpy

    small, verdict = read_ply(ply)
    middles = small.mean(axis=1)
    areas = 0.5 * numpy.linalg.norm(numpy.cross(small[:, 1] - small[:, 0], small[:, 2] - small[:, 0]), axis=1)
    large = numpy.array(corners)[numpy.array(triangles)]
    owner, nearest = numpy.full(len(middles), -1), numpy.full(len(middles), numpy.inf)
    for (a, b, c), face in zip(large, faces):
        u, v = b - a, c - a
        normal = numpy.cross(u, v)
        whole = normal @ normal
        if whole == 0.0:
            continue
        offset = middles - a
        s = numpy.cross(offset, v) @ normal / whole
        t = numpy.cross(u, offset) @ normal / whole
        away = numpy.abs(offset @ normal) / numpy.sqrt(whole)
        # Beside the triangle counts as farther.
        beside = numpy.maximum(numpy.maximum(-s, -t), s + t - 1.0).clip(0.0)
        away = away + beside * numpy.sqrt(numpy.sqrt(whole))
        better = away < nearest
        owner[better], nearest[better] = face, away[better]
    found = []
    for face in range(count):
        own = owner == face
        area = areas[own].sum()
        found.append(float(areas[own & (verdict == 0)].sum() / area) if area > 0.0 else float("nan"))
    return found


def access(shape, tool, pitch=None):
    """The share of each face that the tool of a file reaches."""
    command = os.environ.get("IMF") or shutil.which("imf")
    if not command:
        raise RuntimeError("the command imf is not on the PATH: install it, or name it in the environment variable IMF")
    with tempfile.TemporaryDirectory() as folder:
        corners, triangles, faces = mesh_of(shape)
        part, out = os.path.join(folder, "part.obj"), os.path.join(folder, "out")
        write_obj(part, corners, triangles)
        run = [command, "access", part, "--unit", "mm", "--tool", tool, "--out", out]
        run += ["--pitch", str(pitch)] if pitch else []
        done = subprocess.run(run, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)
        if done.returncode != 0:
            said = done.stderr.strip().splitlines() or ["imf was ended from outside (%d)" % done.returncode]
            raise RuntimeError(said[-1])
        return shares(corners, triangles, faces, len(shape.Faces), os.path.join(out, "surface.ply")), done.stdout


def colour(share):
    """From orange to green; grey where nothing is known."""
    if share != share:
        return (0.6, 0.6, 0.6)
    low, high = (0.92, 0.55, 0.16), (0.47, 0.75, 0.43)
    return tuple(a + (b - a) * share for a, b in zip(low, high))


def of_selection():
    """In FreeCAD's window: the selected body and tool bit."""
    import FreeCADGui
    from PySide import QtGui

    selected = FreeCADGui.Selection.getSelection()
    # A tool controller has its bit; what the Part workbench cuts away is called a tool as well.
    tools = [getattr(own, "Tool", None) for own in selected]
    selected = [tool if tool is not None and is_bit(tool) else own for own, tool in zip(selected, tools)]
    bits = [own for own in selected if is_bit(own)]
    bodies = [own for own in selected if getattr(own, "Shape", None) and not is_bit(own)]
    if len(bodies) != 1:
        raise RuntimeError("select one body, and a tool bit if there is one")
    body = bodies[0]
    with tempfile.TemporaryDirectory() as folder:
        if bits:
            tool = os.path.join(folder, "bit.fctb")
            with open(tool, "w") as file:
                file.write(bit_text(bits[0]))
        else:
            tool = QtGui.QFileDialog.getOpenFileName(None, "A tool of imf", "", "Tools (*.toml *.fctb *.json)")[0]
            if not tool:
                return
        found, text = access(body.Shape, tool)
    if not hasattr(body, RESULT):
        body.addProperty("App::PropertyFloatList", RESULT, "imf", "Share of each face that the tool reaches")
    setattr(body, RESULT, found)
    # What is seen of a body of Part Design is its last feature.
    for shown in filter(None, (body, getattr(body, "Tip", None))):
        # Without a fourth number, which is transparency up to FreeCAD 0.21 and its opposite since.
        shown.ViewObject.DiffuseColor = [colour(share) for share in found]
    FreeCAD.Console.PrintMessage(text)


def body_of(document, name=None):
    """The visible body of a document, or the one of a name or label: what stands inside another body is a step of its history."""
    bodies = [own for own in document.Objects if getattr(own, "Shape", None) and own.Shape.Solids and not is_bit(own)]
    bodies = [own for own in bodies if not hasattr(own.getParentGeoFeatureGroup(), "Shape")]
    if name:
        bodies = [own for own in bodies if name in (own.Name, own.Label)]
    else:
        bodies = [own for own in bodies if own.Visibility]
    if len(bodies) != 1:
        names = ", ".join(own.Label for own in bodies) or "none"
        raise RuntimeError("one body is wanted, and the document has: %s; name one in IMF_BODY, or show it alone" % names)
    return bodies[0]


def headless(part, tool, pitch=None, name=None):
    """Without a window: prints the share of each face."""
    if part.lower().endswith(".fcstd"):
        shape = body_of(FreeCAD.openDocument(part), name).Shape
    else:
        shape = Part.Shape()
        shape.read(part)
    found, text = access(shape, tool, pitch)
    print(text)
    for index, (face, share) in enumerate(zip(shape.Faces, found)):
        print("Face%d  %-10s %10.1f mm2  reached %5.1f %%" % (index + 1, face.Surface.TypeId.split("Geom")[-1], face.Area, 100 * share))


if FreeCAD.GuiUp:
    of_selection()
elif "IMF_PART" in os.environ:
    headless(os.environ["IMF_PART"], os.environ["IMF_TOOL"], os.environ.get("IMF_PITCH"), os.environ.get("IMF_BODY"))
