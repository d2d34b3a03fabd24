"""Pictures as a camera turned on the spot, moved nearer or a mirror would have shown them.

The papers' networks were trained without; their test frames came from the recordings that they were
trained on. In rooms that it has never seen a network of theirs fails, since it learns a few
thousand pictures by heart. So this is ours, and a configuration says whether it is used.

Turning a camera about its own centre moves every pixel by a homography, whatever the scene, and
turns every point: exact. A mirror is exact, too, of a robot that is mirrored. A step
along the optical axis, from depth z of the base to z / s, is taken as a zoom by s: exact for the
base, and for a point d before or behind it off by d (s - 1) / z of its place in the picture, a
fraction of a pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from armsight.recognition.networks.losses import Targets


@dataclass(frozen=True)
class Augmentation:
    """How much pictures are changed; every bound is that of a uniform draw.

    Attributes:
        turn_deg: the camera's pan and tilt [deg], either way.
        roll_deg: about the optical axis [deg], either way.
        zoom: nearer or farther, either way; 0.15 is 0.85 to 1.15.
        mirror: half of the pictures left to right.
        colour: gain of each channel and of all, either way.
        noise: standard deviation of the strongest noise, of a range of 1.
        background: share of the pictures whose robot is put before another picture's room.
    """

    turn_deg: float = 0.0
    roll_deg: float = 0.0
    zoom: float = 0.0
    mirror: bool = False
    colour: float = 0.0
    noise: float = 0.0
    background: float = 0.0


class Augmenter:
    """Changes batches; the same seed, stage and update give the same change.

    Args:
        how: how much.
        K: (3, 3) camera of the pictures [px].
        seed: of every draw.
        stage: number of the training's stage.
    """

    def __init__(self, how: Augmentation, K: Tensor, seed: int, stage: int) -> None:
        self._how, self._K = how, K.to(torch.float32)
        self._seed = (seed * 1_000_003 + stage) * 1_000_003

    def __call__(self, images: Tensor, truth: Targets, update: int) -> tuple[Tensor, Targets]:
        """Changed (n, h, w, 3) uint8 images and their truth."""
        draws = torch.Generator().manual_seed((self._seed + update) % (2**63))
        device = images.device
        turn, zoom, mirror = self._motion(len(images), draws)
        grid = self._grid(turn, zoom, mirror, images.shape[1], images.shape[2]).to(device)
        images = self._other_rooms(images, truth.mask, draws)
        x = images.permute(0, 3, 1, 2).to(torch.float32)
        x = functional.grid_sample(x, grid, "bilinear", "border", align_corners=True)
        x = self._colours(x, draws)
        mask = functional.grid_sample(
            truth.mask[:, None].to(torch.float32), grid, "bilinear", "zeros", align_corners=True
        )
        moved = move(truth, turn.to(device), zoom.to(device), mirror.to(device))
        moved = Targets(mask[:, 0] >= 0.5, moved.joints, moved.has_joint, moved.base, moved.type)
        return x.round().clamp(0, 255).to(torch.uint8).permute(0, 2, 3, 1), moved

    def _other_rooms(self, images: Tensor, mask: Tensor, draws: torch.Generator) -> Tensor:
        """Robots of some pictures before the rooms of others of the batch.

        A set with few rooms, each with one type of robot, teaches type and place by the room; so
        rooms change hands. Where the other picture has its own robot, its mirror image fills in,
        and where that has the robot, too, the first picture's pixels stay.
        """
        if self._how.background <= 0.0:
            return images
        order = torch.randperm(len(images), generator=draws)
        chosen = torch.rand(len(images), 1, 1, generator=draws) < self._how.background
        room, taken = images[order], mask[order]
        mirrored, also_taken = room.flip(2), taken.flip(2)
        room = torch.where(taken[..., None], mirrored, room)
        keep = mask | (taken & also_taken) | ~chosen.to(mask.device)
        return torch.where(keep[..., None], images, room)

    def _motion(self, count: int, draws: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """(n, 3, 3) turns of the camera, (n,) zooms, (n,) 1 or -1 where mirrored."""
        how = self._how
        angles = math.pi / 180.0 * _uniform(count, 3, draws)
        turn = _turns(angles * torch.tensor([how.turn_deg, how.turn_deg, how.roll_deg]))
        zoom = 1.0 + how.zoom * _uniform(count, 1, draws)[:, 0]
        mirror = torch.where(_uniform(count, 1, draws)[:, 0] < 0.0, -1.0, 1.0)
        return turn, zoom, mirror if how.mirror else torch.ones(count)

    def _grid(self, turn: Tensor, zoom: Tensor, mirror: Tensor, height: int, width: int) -> Tensor:
        """(n, h, w, 2) places in the old pictures, in -1..1, that the new pixels look at."""
        rows, columns = torch.meshgrid(
            torch.arange(height, dtype=torch.float32),
            torch.arange(width, dtype=torch.float32),
            indexing="ij",
        )
        pixels = torch.stack([columns, rows, torch.ones_like(rows)], -1)
        rays = pixels @ torch.linalg.inv(self._K).T
        # New coordinates are mirror(turn(old)), and x/z and y/z then grow by the zoom.
        scale = torch.stack([mirror * zoom, zoom, torch.ones_like(zoom)], -1)
        rays = torch.einsum("nji,nhwj->nhwi", turn, rays[None] / scale[:, None, None])
        old = rays @ self._K.T
        places = old[..., :2] / old[..., 2:].clamp(min=1e-3)
        return 2.0 * places / torch.tensor([width - 1.0, height - 1.0]) - 1.0

    def _colours(self, x: Tensor, draws: torch.Generator) -> Tensor:
        count, how = len(x), self._how
        gain = 1.0 + how.colour * (
            0.5 * _uniform(count, 3, draws) + 0.5 * _uniform(count, 1, draws)
        )
        x = x * gain[:, :, None, None].to(x.device)
        strength = 255.0 * how.noise * torch.rand(count, 1, 1, 1, generator=draws)
        if how.noise > 0.0:
            x = x + (strength * torch.randn(x.shape, generator=draws)).to(x.device)
        return x


def move(truth: Targets, turn: Tensor, zoom: Tensor, mirror: Tensor) -> Targets:
    """The points of a batch after the camera was turned, mirrored and moved nearer."""
    flip = torch.stack([mirror, torch.ones_like(mirror), torch.ones_like(mirror)], -1)
    base = torch.einsum("nij,nj->ni", turn, truth.base) * flip
    joints = torch.einsum("nij,nkj->nki", turn, truth.joints) * flip[:, None]
    nearer = torch.zeros_like(base)
    nearer[:, 2] = base[:, 2] * (1.0 / zoom - 1.0)
    return Targets(truth.mask, joints + nearer[:, None], truth.has_joint, base + nearer, truth.type)


def _uniform(count: int, width: int, draws: torch.Generator) -> Tensor:
    """(count, width) in -1..1."""
    return 2.0 * torch.rand(count, width, generator=draws) - 1.0


def _turns(angles: Tensor) -> Tensor:
    """(n, 3, 3) rotations about x, then y, then z by (n, 3) angles [rad]."""
    zero, one = torch.zeros(len(angles)), torch.ones(len(angles))
    (cx, cy, cz), (sx, sy, sz) = angles.cos().T, angles.sin().T
    about_x = torch.stack([one, zero, zero, zero, cx, -sx, zero, sx, cx], -1)
    about_y = torch.stack([cy, zero, sy, zero, one, zero, -sy, zero, cy], -1)
    about_z = torch.stack([cz, -sz, zero, sz, cz, zero, zero, zero, one], -1)
    x, y, z = (m.unflatten(-1, (3, 3)) for m in (about_x, about_y, about_z))
    return z @ y @ x
