"""Is a URDF a robot at all? One pass over the file before anything is built from it. Failures are InputErrors."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from xml.parsers import expat

from rearticulate.bounds import shown
from rearticulate.errors import InputError, one_line
from rearticulate.invariants import check_names

TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
SIZES = {"box": {"size": 3}, "cylinder": {"radius": 1, "length": 1}, "sphere": {"radius": 1}}  # numbers a key
LARGEST_FILE = 64 * 2**20  # bytes
MOST_LINKS = 2000
MOST_VISUALS = 10_000
DEEPEST = 50  # elements in one another
LARGEST = 1e6  # m, rad, or a scale

Element = ET.Element


def check_urdf(path: Path) -> None:
    """Well-formed and small enough, one root that carries all links, no cycles, numbers that are numbers.

    Names are known and unique; sizes are not negative, limits in order, axes have a direction.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such URDF file")
    robot = _read(path)
    try:
        links, joints = robot.findall("link"), robot.findall("joint")
        if len(links) > MOST_LINKS or len(joints) > MOST_LINKS:
            raise InputError(f"{len(links)} links and {len(joints)} joints are too many, {MOST_LINKS} at most")
        for kind, elements in (("link", links), ("joint", joints)):
            check_names(kind, [element.get("name") for element in elements], len(elements))
        _check_tree([link.get("name", "") for link in links], joints)
        for joint in joints:
            _check_joint(joint)
        _check_mimics({joint.get("name", ""): joint for joint in joints})
        _check_visuals(links)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _read(path: Path) -> Element:
    """The root element. Prefixes need no namespace; document types, which hold entities, are refused."""
    if path.stat().st_size > LARGEST_FILE:
        raise InputError(f"{path}: larger than {LARGEST_FILE // 2**20} MiB, which no URDF is")
    builder, parser, open_tags = ET.TreeBuilder(), expat.ParserCreate(), []

    def start(tag: str, attributes: dict[str, str]) -> None:
        open_tags.append(tag)
        if len(open_tags) > DEEPEST:
            raise InputError(f"{path}: elements are nested more than {DEEPEST} deep")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        open_tags.pop()
        builder.end(tag)

    def doctype(*_: object) -> None:
        raise InputError(f"{path}: a document type (DOCTYPE) is not read")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(path.read_bytes(), True)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    except expat.ExpatError as error:
        raise InputError(f"{path}: not a URDF that can be read ({one_line(error)})") from error
    robot = builder.close()
    if robot.tag != "robot":
        raise InputError(f"{path}: not a URDF, its first element is {shown(robot.tag)} and not 'robot'")
    return robot


def _check_tree(links: list[str], joints: list[Element]) -> None:
    """Every link but the root is carried by one joint, and all of them by the root in the end."""
    parent: dict[str, str] = {}
    for joint in joints:
        name, above, below = joint.get("name"), _end(joint, "parent"), _end(joint, "child")
        for link in (above, below):
            if link not in links:
                raise InputError(f"joint {name!r} names a link {shown(link)} that does not exist")
        if below in parent:
            raise InputError(f"link {below!r} is carried by two joints; a link has one parent")
        parent[below] = above
    roots = [link for link in links if link not in parent]
    if len(roots) != 1:
        raise InputError(f"a URDF has one root link, this one has {len(roots)}: {', '.join(roots[:9])}")
    for link in links:
        top = _followed(link, parent)
        if top is None:
            raise InputError(f"link {link!r} carries itself: the joints must be a tree")


def _check_joint(joint: Element) -> None:
    where = f"joint {joint.get('name')!r}"
    kind = joint.get("type")
    if kind not in TYPES:
        raise InputError(f"{where} has the type {shown(kind)}; there are {', '.join(TYPES)}")
    _check_origin(joint, where)
    axis, limit = joint.find("axis"), joint.find("limit")
    direction = [1.0, 0.0, 0.0] if axis is None else _numbers(axis, "xyz", where, 3, "1 0 0")
    if kind not in ("fixed", "floating") and max(map(abs, direction)) < 1e-6:
        raise InputError(f"{where} has an axis without direction, {direction}")
    if limit is not None and kind in ("revolute", "prismatic"):
        low, high = (_numbers(limit, key, where, 1, "0")[0] for key in ("lower", "upper"))
        if low > high:
            raise InputError(f"{where} has its limits the wrong way round, {low:g} to {high:g}")


def _check_mimics(joints: dict[str, Element]) -> None:
    leader: dict[str, str] = {}
    for name, joint in joints.items():
        mimic = joint.find("mimic")
        if mimic is None:
            continue
        other = mimic.get("joint")
        if other not in joints:
            raise InputError(f"joint {name!r} mimics a joint {shown(other)} that does not exist")
        _numbers(mimic, "multiplier", f"joint {name!r}", 1, "1")
        _numbers(mimic, "offset", f"joint {name!r}", 1, "0")
        leader[name] = other
    for name in leader:
        if _followed(name, leader) is None:
            raise InputError(f"joint {name!r} mimics itself, directly or through others")


def _check_visuals(links: list[Element]) -> None:
    visuals = [(f"link {link.get('name')!r}", visual) for link in links for visual in link.findall("visual")]
    if len(visuals) > MOST_VISUALS:
        raise InputError(f"{len(visuals)} visuals are too many, {MOST_VISUALS} at most")
    for where, visual in visuals:
        _check_origin(visual, where)
        geometry = visual.find("geometry")
        if geometry is None or not len(geometry):
            raise InputError(f"{where} has a visual without geometry")
        _check_shape(geometry[0], where)


def _check_shape(shape: Element, where: str) -> None:
    sizes = SIZES.get(shape.tag, {})
    if shape.tag == "mesh":
        if not shape.get("filename"):
            raise InputError(f"{where} has a mesh without filename")
        if shape.get("scale", "").strip():
            width = 1 if len(shape.get("scale", "").replace(",", " ").split()) == 1 else 3
            if 0 in _numbers(shape, "scale", where, width):
                raise InputError(f"{where} has a mesh with a scale of 0")
    elif not sizes:
        raise InputError(f"{where} has a shape {shown(shape.tag)}; there are box, cylinder, sphere and mesh")
    for key, count in sizes.items():
        if min(_numbers(shape, key, where, count)) < 0:
            raise InputError(f"{where} has a {shape.tag} whose {key} is negative")


def _check_origin(element: Element, where: str) -> None:
    origin = element.find("origin")
    if origin is not None:
        _numbers(origin, "xyz", where, 3, "0 0 0")
        _numbers(origin, "rpy", where, 3, "0 0 0", more=True)  # some robots have a fourth one, which says nothing


def _numbers(
    element: Element, key: str, where: str, count: int, default: str | None = None, more: bool = False
) -> list[float]:
    """So many (or more) finite numbers of an attribute."""
    text = element.get(key, default)
    try:
        values = [float(word) for word in (text or "").replace(",", " ").split()]
    except ValueError:
        values = []
    fits = len(values) == count or (more and len(values) > count)
    if not fits or not all(abs(value) <= LARGEST for value in values):
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        raise InputError(f"{key} in {where} must be {wanted} of {LARGEST:g} at most, not {shown(text)}")
    return values


def _end(joint: Element, tag: str) -> str:
    element = joint.find(tag)
    link = None if element is None else element.get("link")
    if link is None:
        raise InputError(f"joint {joint.get('name')!r} names no {tag} link")
    return link


def _followed(name: str, above: dict[str, str]) -> str | None:
    """The end of the way upwards; None where it goes round."""
    for _ in range(len(above) + 1):
        if name not in above:
            return name
        name = above[name]
    return None
