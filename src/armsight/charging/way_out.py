"""What is needed to come out of a car again, kept on disk while the plug may be in it."""

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

    Raises:
        JournalError: there is a journal that cannot be believed.
    """

    def __init__(self, journal: Journal, plug: str) -> None:
        self._journal, self._plug = journal, plug
        self.left: Entry | None = journal.read()

    def keep(
        self,
        port: SeenPort,
        feeling: Feeling,
        plugged: bool,
        T_base_lid: Pose | None = None,
        at_lid: bool = False,
    ) -> str:
        """Write down how to come out of a port; why that cannot be, in words; empty when it was.

        Args:
            port: where it is.
            feeling: of a plug that has been tared.
            plugged: the plug is seated; else it is on its way in.
            T_base_lid: a lid that was opened, or is worked at.
            at_lid: it is worked at.
        """
        assert feeling.tare is not None
        hung, tare = feeling.T_flange_plug, feeling.tare
        T = port.T_base_port
        try:
            self._journal.write(
                Entry(port.port, self._plug, T, hung, tare, plugged, T_base_lid, at_lid)
            )
        except JournalError as error:
            return str(error)
        return ""

    def forget(self) -> str:
        """The plug is out; what went wrong in saying so, in words."""
        try:
            self._journal.clear()
        except JournalError as error:
            return str(error)
        return ""
