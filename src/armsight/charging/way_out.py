"""What is needed to come out of a car and home again, kept on disk until the arm is there."""

from __future__ import annotations

from armsight.arrays import Pose
from armsight.charging.eye import SeenPort
from armsight.charging.feeling import Feeling
from armsight.charging.journal import Entry, Journal, JournalError


class WayOut:
    """Writes the journal of one station.

    Args:
        journal: where it is kept.
        plug: type of the station's plug.

    Attributes:
        left: what a station that was killed has left; None when nothing.
        kept: something is on disk.

    Raises:
        JournalError: there is a journal that cannot be believed.
    """

    def __init__(self, journal: Journal, plug: str) -> None:
        self._journal, self._plug = journal, plug
        self.left: Entry | None = journal.read()
        self.kept = self.left is not None

    def keep(
        self,
        port: SeenPort,
        feeling: Feeling,
        plugged: bool = False,
        T_base_lid: Pose | None = None,
        at_lid: bool = False,
    ) -> str:
        """Write down how to come out of a port; why that cannot be, in words; empty when it was.

        Args:
            port: where it is, and how sure that is with all.
            feeling: of the plug.
            plugged: the plug is seated; else it is on its way in, or out.
            T_base_lid: a lid that was opened, or is worked at.
            at_lid: it is worked at.
        """
        try:
            self._journal.write(
                Entry(
                    port.port, self._plug, port.T_base_port, port.covariance,
                    feeling.T_flange_plug, feeling.tare, plugged, T_base_lid, at_lid,
                )
            )  # fmt: skip
        except JournalError as error:
            return str(error)
        self.kept = True
        return ""

    def forget(self) -> str:
        """The arm is home; what went wrong in saying so, in words."""
        self.kept = False
        try:
            self._journal.clear()
        except JournalError as error:
            return str(error)
        return ""
