"""Kinds of files by their endings, and files that hold nothing for us."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

STRUCTURED = (".yaml", ".yml", ".json", ".xml")
OTHER = (
    *(".py", ".pyc", ".ipynb", ".c", ".cc", ".cpp", ".h", ".hpp", ".cs", ".java", ".js", ".sh"),
    *(".bat", ".cmake", ".launch", ".md", ".rst", ".html", ".htm", ".css", ".pdf", ".doc"),
    *(
        ".odt",
        ".ppt",
        ".pptx",
        ".zip",
        ".gz",
        ".tar",
        ".7z",
        ".rar",
        ".ply",
        ".pcd",
        ".stl",
        ".obj",
    ),
    *(".dae", ".urdf", ".xacro", ".mp4", ".avi", ".mov", ".mkv", ".zdf", ".svg", ".gif"),
    *(".pt", ".pth", ".onnx", ".rdk", ".so", ".dll", ".exe", ".fig", ".asv", ".lock"),
)
"""Endings of files that hold no poses: programs, papers, archives, meshes, films."""
BAGS = (".bag", ".mcap", ".db3")
_SHEET = "a spreadsheet is not read: save it as CSV"
_PICKLE = "is not opened: a pickle can run programs; save the poses as CSV or .npy"
_HDF = "HDF5 is not read: save the poses as CSV or .npz"
NOT_READ = {
    **dict.fromkeys((".xlsx", ".xls", ".xlsm", ".ods"), _SHEET),
    **dict.fromkeys((".pkl", ".pickle"), _PICKLE),
    **dict.fromkeys((".h5", ".hdf5"), _HDF),
}
"""Endings of files that may hold poses and are not read, and what to do about it."""


def is_text(file: Path) -> bool:
    """Whether a file may be text with poses, by its ending and its first bytes."""
    suffix = file.suffix.lower()
    if suffix in (*OTHER, *BAGS, *STRUCTURED) or suffix in (".mat", ".npy", ".npz"):
        return False
    try:
        with file.open("rb") as stream:
            head = stream.read(512)
    except OSError:
        return True  # whoever reads it says why it cannot be read
    return b"\0" not in head or head[:2] in (b"\xff\xfe", b"\xfe\xff")


@dataclass(frozen=True)
class Unread:
    """A file that holds no poses for us, and why."""

    file: Path
    reason: str
