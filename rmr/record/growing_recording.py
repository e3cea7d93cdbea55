"""Follows the recording of a run that is under way: the files of its processes, while they grow.

Each process puts what it has recorded into its file once a second. Files may come later than others (a robot that is
started again), and stay readable here after the run has joined and removed them.
"""

from pathlib import Path

from rmr.record.mcap_scan import RecordingError
from rmr.record.recording import Message, RawMessage, Recording, RecordingPart, merged, open_part, part_files


class GrowingRecording(Recording):
    """The recording of the run in a folder, so far."""

    def __init__(self, folder: Path) -> None:
        """Raise RecordingError while there is no file that can be read."""
        self._folder = folder
        first = merged(part_files(folder), folder)
        super().__init__(first.parts)
        self._known = {part.scan.name for part in self.parts}
        self._read: dict[str, int] = {}
        """Number of chunks that `news` has returned, by file."""

    def refresh(self) -> None:
        """Take in what has been written since the last call."""
        for file in part_files(self._folder):
            if str(file) not in self._known:
                self._add(file)
        for part in self.parts:
            part.scan.extend()

    def _add(self, file: Path) -> None:
        try:
            part = open_part(file)
        except RecordingError:  # not begun yet: it is tried again
            return
        self._known.add(str(file))
        if part.about.same_run(self.about):
            self.parts = (*self.parts, part)
        else:
            part.scan.close()
            self.add_problem(f"{file}: of another run; it is left out")

    def news(self) -> list[Message]:
        """Return the messages that have come since the last call, in order of time among themselves."""
        self.refresh()
        found: list[Message] = []
        for number, part in enumerate(self.parts):
            chunks = len(part.scan.chunks)
            for place in range(self._read.get(part.scan.name, 0), chunks):
                found += self._news_of(part, number, place)
            self._read[part.scan.name] = chunks
        found.sort(key=lambda message: message.at)
        return found

    def _news_of(self, part: RecordingPart, number: int, place: int) -> list[Message]:
        found: list[Message] = []
        for at, channel, octets in self._loaded(number, place):
            named = part.scan.channels.get(channel)
            if named is not None:
                data = self._decoded(RawMessage(named.topic, at, named.encoding, octets))
                if data is not None:
                    found.append(Message(named.topic, at, data))
        return found
