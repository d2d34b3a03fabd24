"""A set of labelled pictures on disk."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from armsight.arrays import Bytes, Ints
from armsight.errors import DatasetError
from armsight.recognition.data.manifest import Manifest, read_manifest, shard_folder
from armsight.recognition.data.rows import Row, from_json
from armsight.recognition.data.sample import NO_ROBOT, Sample
from armsight.recognition.data.splits import By, Part, split


class LabelledSet:
    """Labelled pictures, read one by one; the labels of all are held in memory.

    Attributes:
        folder: where it lies.
        manifest: what it is.
        rows: labels of every sample, in the order of their indices.
    """

    def __init__(self, folder: Path, manifest: Manifest, rows: list[Row]) -> None:
        self.folder = folder
        self.manifest = manifest
        self.rows = rows

    @classmethod
    def open(cls, folder: Path | str, partial: bool = False) -> LabelledSet:
        """Read the labels of a set.

        Args:
            folder: with ``dataset.toml`` in it.
            partial: take the shards that are finished of a set that is still being made; they
                need not be the first ones. Otherwise every shard has to be there.

        Raises:
            DatasetError: there is no set, it is of another version, a shard is missing or
                damaged.
        """
        folder = Path(folder)
        manifest = read_manifest(folder)
        rows: list[Row] = []
        for shard in range(manifest.shards):
            if partial and not shard_folder(folder, shard).is_dir():
                continue
            rows += read_shard(folder, manifest, shard)
        if not rows:
            raise DatasetError(
                f"{folder}: has no finished shard yet; go on with 'armsight dataset generate'"
            )
        return cls(folder, manifest, rows)

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Sample]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, i: int) -> Sample:
        """Sample i.

        Raises:
            IndexError: there are not as many.
            DatasetError: one of its pictures is missing or damaged.
        """
        row = self.rows[i]
        image, links = self._picture(row, row.image), self._picture(row, row.links)
        return Sample(
            row.index,
            row.seed,
            row.scene,
            row.robot,
            image,
            links > 0,
            links,
            row.K,
            row.distortion,
            row.T_camera_base,
            row.q,
            row.joints_camera,
            row.keypoints_camera,
            row.keypoints_px,
            row.keypoints_visible,
        )

    def image_path(self, i: int) -> Path:
        """File of the colour picture of sample i."""
        return self._folder_of(self.rows[i]) / self.rows[i].image

    def split(self, part: Part, by: By = "frame", seed: int = 0) -> Ints:
        """Indices of the training, validation or test samples.

        Args:
            part: ``train``, ``validation`` or ``test`` (70, 10, 20 %).
            by: ``frame`` as the papers do it, or ``scene`` to hold whole rooms back.
            seed: of the draw.

        Raises:
            UsageError: no such part or way.
        """
        return split([r.robot for r in self.rows], [r.scene for r in self.rows], part, by, seed)

    def _folder_of(self, row: Row) -> Path:
        return shard_folder(self.folder, row.index // self.manifest.shard_size)

    def _picture(self, row: Row, name: str) -> Bytes:
        path = self._folder_of(row) / name
        return read_picture(path, row, color=name == row.image)


def read_shard(folder: Path, manifest: Manifest, shard: int) -> list[Row]:
    """Labels of a shard.

    Raises:
        DatasetError: it is missing, incomplete or damaged; names the line.
    """
    path = shard_folder(folder, shard) / "labels.jsonl"
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        raise DatasetError(
            f"{path}: is missing; finish the set with the 'armsight dataset generate' that began it"
        ) from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise DatasetError(f"{path}: is no text; delete the shard and generate again") from None
    indices = manifest.shard_indices(shard)
    if len(lines) != len(indices):
        raise DatasetError(
            f"{path}: has {len(lines)} lines for {len(indices)} samples; "
            "delete the shard and generate again"
        )
    rows = []
    for number, (line, index) in enumerate(zip(lines, indices), start=1):
        try:
            row = from_json(line)
            _check_place(row, manifest, index)
        except ValueError as error:
            raise DatasetError(
                f"{path}, line {number}: {error}; delete the shard and generate again"
            ) from None
        rows.append(row)
    return rows


def read_picture(path: Path, row: Row, color: bool) -> Bytes:
    """(h, w, 3) RGB or (h, w) link ids.

    Raises:
        DatasetError: the file is missing, damaged, or of another size than the labels say.
    """
    try:
        raw = np.fromfile(path, np.uint8)
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror})") from None
    if _is_truncated(raw):
        raise DatasetError(f"{path}: is truncated; delete its shard and generate again")
    flag = cv2.IMREAD_COLOR if color else cv2.IMREAD_UNCHANGED
    try:
        picture = cv2.imdecode(raw, flag)
    except cv2.error:
        picture = None
    if picture is None:
        raise DatasetError(f"{path}: is no picture or damaged; delete its shard, generate again")
    wanted = (row.height, row.width, 3) if color else (row.height, row.width)
    if picture.shape != wanted or picture.dtype != np.uint8:
        raise DatasetError(
            f"{path}: is {picture.shape} {picture.dtype}, expected {wanted} uint8; "
            "delete its shard and generate again"
        )
    if not color and picture.max(initial=0) > len(row.q) + 1:
        raise DatasetError(f"{path}: names a link that {row.robot} does not have; is it damaged?")
    if not color and row.robot == NO_ROBOT and picture.any():
        raise DatasetError(f"{path}: shows a robot where the labels say none; is it damaged?")
    return np.ascontiguousarray(picture[..., ::-1]) if color else np.asarray(picture)


_JPEG, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_PNG, _PNG_END = b"\x89PNG", b"IEND\xaeB`\x82"


def _is_truncated(raw: Bytes) -> bool:
    """Whether a JPEG or PNG lacks its end; OpenCV would fill the rest with grey, silently."""
    head, tail = raw[:4].tobytes(), raw[-8:].tobytes()
    if head.startswith(_JPEG):
        return not tail.endswith(_JPEG_END)
    return head == _PNG and not tail.endswith(_PNG_END)


def _check_place(row: Row, manifest: Manifest, index: int) -> None:
    if row.index != index:
        raise ValueError(f"index is {row.index}, expected {index}")
    if (row.width, row.height) != (manifest.width, manifest.height):
        raise ValueError(
            f"size is {row.width} x {row.height}, the set's is {manifest.width} x {manifest.height}"
        )
    if row.robot not in manifest.counts:
        raise ValueError(f'robot "{row.robot}" is not in the set')
