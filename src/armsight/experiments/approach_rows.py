"""What ``approach`` reports of contacts, and of the search for one."""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.experiments.approach_episode import CAPS
from armsight.experiments.rows import Row, contact_row, share_row


def contact_rows(episodes: list[dict[str, Any]], hunts: list[dict[str, Any]]) -> list[Row]:
    """Contacts in all episodes and by the speed of the hands, and what the search found."""
    rows = []
    for cap in (None, *CAPS):
        mine = [e for e in episodes if cap in (None, e["cap"])]
        if not mine:
            continue
        condition = "all episodes" if cap is None else f"hands up to {cap} m/s"
        contacts = sum(e["contacts"] for e in mine)
        rows.append(contact_row(contacts, "a person", condition, len(mine)))
        touched = sum(e["contacts"] > 0 for e in mine)
        what = "share of episodes with such a contact, and its 95 % interval (Wilson)"
        rows.append(share_row("contact_share", what, condition, touched, len(mine)))
        near = [e["least_moving"] for e in mine]
        rows.append(
            Row(
                "least_moving_m",
                "least true distance to a person while the arm moved, 5 % quantile beside it",
                condition,
                min(near),
                "m",
                n=len(mine),
                low=min(near),
                high=float(np.quantile(near, 0.05)),
                paper=0.02 if cap is None else None,
            )
        )
    other = sum(e["other_contacts"] for e in episodes)
    rows.append(
        Row(
            "other_contacts",
            "contacts of the moving arm with anything that is no person",
            "all episodes",
            float(other),
            n=len(episodes),
        )
    )
    rows.append(
        Row(
            "moving_share",
            "share of the time in which the arm followed a path, mean: a guard that never lets it "
            "move touches nobody either",
            "all episodes",
            float(np.mean([e["moved"] for e in episodes])),
            n=len(episodes),
            better="higher",
        )
    )
    rows.append(
        Row(
            "standing_contacts",
            "contacts with an arm that stood or moved at less than 0.05 m/s: people touch it",
            "all episodes",
            float(sum(e["standing_contacts"] for e in episodes)),
            n=len(episodes),
        )
    )
    what = "contacts of the moving arm that the search forced, in all its trials"
    rows += search_rows(hunts, ("search_contacts", what), ("search_margin_m", "hand at"))
    return rows


def over_rows(hunts: list[dict[str, Any]]) -> list[Row]:
    """The same of people who reach over the top of the mapped box."""
    what = (
        "contacts with people who stand and reach in over the top of the mapped box, searched for"
    )
    return search_rows(hunts, ("over_contacts", what), ("over_margin_m", "somebody at"))


def search_rows(
    hunts: list[dict[str, Any]], contacts: tuple[str, str], margin: tuple[str, str]
) -> list[Row]:
    """What searches found, by the speed of the hands.

    Args:
        hunts: of :func:`armsight.experiments.hand_search.cross_entropy`, with their ``cap`` [m/s].
        contacts: key and words of their count.
        margin: key of the least distance, and who came.
    """
    rows = []
    for cap in CAPS:
        mine = [h for h in hunts if h["cap"] == cap]
        if not mine:
            continue
        touched, trials = (sum(h[key] for h in mine) for key in ("contacts", "trials"))
        condition = f"{margin[1]} {cap} m/s"
        rows.append(
            Row(*contacts, condition, float(touched), n=trials, must=0.0, aim=0.0),
        )
        rows.append(
            Row(
                margin[0],
                "least distance to the moving arm that the search found",
                condition,
                min(h["margin"] for h in mine),
                "m",
                n=trials,
                better="higher",
            )
        )
    return rows


def above_row(hunts: list[dict[str, Any]]) -> Row:
    """Contacts with hands that come from above the mapped box."""
    touched, trials = (sum(h[key] for h in hunts) for key in ("contacts", "trials"))
    return share_row(
        "above_contacts",
        "share of hands from above the mapped box that touch the moving arm: there is nobody to "
        "whom they belong, so the proof does not hold",
        "hands up to 2.0 m/s, alone in the air",
        touched,
        trials,
    )
