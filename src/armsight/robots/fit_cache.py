"""Shapes that were fitted to a user's arm, kept in the user's cache folder.

A file's name is the hash of everything that the fit was made from, so that a changed URDF or mesh
is fitted anew and nothing in the cache is ever out of date.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from armsight.errors import RobotError
from armsight.robots.chain import Chain
from armsight.robots.shapes import BodyShapes, read_shapes, shapes_json
from armsight.writing import write_text

FIT_VERSION = 1
"""Raised when the fit gives other shapes from the same files."""


def fingerprint(chain: Chain, urdf: Path) -> str:
    """Hash of an arm's URDF, of its folded chain, and of its meshes' files.

    Raises:
        RobotError: the URDF or a mesh cannot be read.
    """
    digest = hashlib.sha256(f"{FIT_VERSION}\n{chain.flange}\n".encode())
    files = [urdf]
    for link in chain.links:
        digest.update(f"{link.name}\n".encode() + link.T_parent_joint.tobytes())
        if link.joint is not None and link.joint.kind == "continuous":
            digest.update(b"turned")  # earlier fits held such joints still
        for shape in (*link.visuals, *link.collisions):
            digest.update(shape.T_link_geometry.tobytes())
            if shape.path is not None and shape.path.is_file():  # who needs it says it is missing
                files.append(shape.path)
    kinds = {shape.kind for link in chain.links for shape in link.collisions}
    bare = kinds == {"sphere"} and not all(link.spheres for link in chain.links)
    if bare or any(len(link.body) > len(link.visuals or link.collisions) for link in chain.links):
        digest.update(b"whole")  # earlier fits left parts of such arms without spheres
    for path in dict.fromkeys(files):
        try:
            digest.update(path.read_bytes())
        except OSError as error:
            raise RobotError(f"{path}: cannot be read ({error.strerror})") from None
    return digest.hexdigest()[:32]


def cache_folder() -> Path:
    """Where fits are kept: ``$XDG_CACHE_HOME/armsight/shapes``, by default below ``~/.cache``."""
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "armsight" / "shapes"


def cached_shapes(mark: str, link_names: tuple[str, ...]) -> BodyShapes | None:
    """Shapes kept under a fingerprint; None where there are none, or they were damaged."""
    file = cache_folder() / f"{mark}.json"
    if not file.is_file():
        return None
    try:
        return read_shapes(file, link_names)
    except RobotError:
        return None  # half of a disk, an older format: fitted and written again


def keep_shapes(mark: str, shapes: BodyShapes, link_names: tuple[str, ...]) -> Path | None:
    """Keep shapes under a fingerprint; where, or None when the folder cannot be written."""
    file = cache_folder() / f"{mark}.json"
    try:
        write_text(file, shapes_json(shapes, link_names, mark), RobotError)
    except RobotError:
        return None
    return file
