"""Writing a log: an MCAP file that is on the disk at least once a second and can be read whatever happens next."""

import contextlib
import io
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TypeAlias

import numpy as np
from mcap.writer import Writer

import imutui
from imutui.logbook import atomic_file, checksum_file, log_stream, log_time, schemas
from imutui.logbook.session_info import METADATA, SessionInfo
from imutui.logbook.summary import CONFIGURATION, SUMMARY

Encoded: TypeAlias = tuple[str, bytes, int, int]
"""A message: topic, CDR bytes, log time and publish time (UTC, ns)."""


@contextlib.contextmanager
def whole_log(
    path: Path, info: SessionInfo, configuration: str, *, overwrite: bool, mode: int
) -> Iterator["LogWriter"]:
    """Yield the writer of a log that takes its name when the block ends, with its checksum beside it.

    Parameters and errors are those of `LogWriter`; the block has to call `finish`. If it raises, nothing is left.
    """
    with atomic_file.part_of(path, overwrite=overwrite, mode=mode) as part:
        log = LogWriter(part, info, configuration, log_time.now_ns(), overwrite=True, mode=mode, checksum=False)
        yield log
    # the log is whole without it
    with contextlib.suppress(OSError):
        if log.sha256 is not None:
            checksum_file.write(path, log.sha256, mode)


class LogWriter:
    """One log file being written.

    `path`: created; the folder too.
    `info`: written first, so that even the shortest file says what it is.
    `configuration`: effective configuration, TOML, kept as an attachment.
    `now_ns`: UTC, ns.
    `overwrite`: replace an existing file.
    `mode`: permissions of the file, and of its sum.
    `checksum`: whether its SHA-256 is put beside it on closing.
    `raw_type`: type of the packets, `schemas.raw_type`.
    `path`: where the file is.
    `sha256`: hash of the whole file once it is finished; it was made while writing.
    Raises FileExistsError if `path` exists and may not be overwritten.
    Raises OSError if the disk does not take it; the file then ends with the last good flush, and one without a message
      on the disk is removed.
    """

    def __init__(
        self,
        path: Path,
        info: SessionInfo,
        configuration: str,
        now_ns: int,
        *,
        overwrite: bool = False,
        mode: int = log_stream.MODE,
        checksum: bool = True,
        raw_type: str = schemas.TYPES[schemas.RAW],
    ) -> None:
        self.path = path
        self.sha256: str | None = None
        self._mode = mode
        self._has_checksum = checksum
        self._raw_file = log_stream.create(path, overwrite=overwrite, mode=mode)
        self._file = io.BufferedWriter(self._raw_file)
        self._good = 0
        self._good_messages = 0
        self._channels: dict[str, int] = {}
        self._counts = dict.fromkeys(schemas.TYPES, 0)
        self._broken = False
        with self._or_abandoned():
            self._writer = Writer(self._file, enable_data_crcs=True)
            self._writer.start("ros2", f"imutui {imutui.__version__}")
            self._writer.add_metadata(METADATA, info.strings())
            self.attach(CONFIGURATION, "application/toml", configuration.encode(), now_ns)
            for topic, typename in (schemas.TYPES | {schemas.RAW: raw_type}).items():
                schema = self._writer.register_schema(typename, "ros2msg", schemas.definition(typename).encode())
                told = schemas.CHANNEL_METADATA.get(topic, {})
                self._channels[topic] = self._writer.register_channel(topic, "cdr", schema, told)
            self.flush()

    @property
    def is_empty(self) -> bool:
        """Whether no message of it is on the disk; if writing has failed too, there is no such file."""
        return not self._good_messages

    @property
    def size(self) -> int:
        """Bytes on the disk as of the last flush."""
        return self._good

    def imu(self, log_ns: int, stamp_ns: int, gyro: np.ndarray, accel: np.ndarray, *, valid: bool = True) -> None:
        """Write an output sample: rad/s and m/s² (specific force) in body axes; not `valid`: none at this stamp."""
        self.encoded(schemas.IMU, schemas.encode_imus(stamp_ns, gyro, accel, valid)[0], log_ns, stamp_ns)

    def all_encoded(self, messages: Iterable[Encoded]) -> None:
        """Write the bytes of some messages of `schemas`, in order."""
        for message in messages:
            self.encoded(*message)

    def encoded(self, topic: str, data: bytes, log_ns: int, stamp_ns: int) -> None:
        """Write the bytes of a message of `schemas`."""
        if topic == schemas.IMU and not self._counts[schemas.TRANSFORMS]:
            # what the samples' frame is, before the first of them, at its time: viewers would show years before it
            self.encoded(schemas.TRANSFORMS, schemas.encode_transforms(stamp_ns), log_ns, stamp_ns)
        count = self._counts[topic]
        self._counts[topic] = count + 1
        try:
            self._writer.add_message(self._channels[topic], log_ns, data, stamp_ns, count & 0xFFFFFFFF)
        except OSError as error:
            self._abandon(error)
            raise

    def attach(self, name: str, media_type: str, data: bytes, now_ns: int) -> None:
        """Add an attachment, stamped with `now_ns`, UTC, ns."""
        with self._or_abandoned():
            self._writer.add_attachment(now_ns, now_ns, name, media_type, data)

    def describe(self, info: SessionInfo) -> None:
        """Write the session's metadata again, with what has changed in it; readers take the last."""
        with self._or_abandoned():
            self._writer.add_metadata(METADATA, info.strings())

    def flush(self) -> None:
        """Close the chunk and see it onto the disk."""
        with self._or_abandoned():
            self._writer.flush()  # type: ignore[no-untyped-call]
            os.fdatasync(self._file.fileno())
        self._take_note()

    def _take_note(self) -> None:
        """All that was written is on the disk."""
        self._good = self._file.tell()
        self._good_messages = sum(self._counts.values())

    def finish(self, summary: Mapping[str, object], now_ns: int) -> None:
        """Write the quality summary and the index, and close; after a failure there is nothing left to do."""
        if self._broken:
            return
        with self._or_abandoned():
            text = json.dumps(summary, indent=1, allow_nan=False)
            self.attach(SUMMARY, "application/json", text.encode(), now_ns)
            self._writer.finish()  # type: ignore[no-untyped-call]
            self.flush_file()
        self.sha256 = self._raw_file.sha256()
        # the log is whole without it, and `check` does not miss it: a disk that is full by now harms nothing
        with contextlib.suppress(OSError):
            if self._has_checksum and self.is_there():
                checksum_file.write(self.path, self.sha256, self._mode)
        with contextlib.suppress(OSError):  # all of it is on the disk
            self._file.close()

    def is_there(self) -> bool:
        """Return whether the path leads to this file still. Raises OSError if its disk does not answer."""
        return log_stream.is_at(self._file.fileno(), self.path)

    def flush_file(self) -> None:
        """See the file's last bytes onto the disk."""
        self._file.flush()
        os.fsync(self._file.fileno())
        self._take_note()

    @contextlib.contextmanager
    def _or_abandoned(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self._abandon(error)
            raise

    def _abandon(self, error: OSError) -> None:
        # A writer that failed once must not finish: part of a chunk may be on the disk, and writing it again would
        # double it. The file is cut back to its last good flush instead, as an unfinished but readable log.
        error.filename = error.filename or str(self.path)
        if self._broken:
            return
        self._broken = True
        descriptor = os.dup(self._file.fileno())
        try:
            # closing tries once more to write what could not be written; the descriptor is closed either way
            with contextlib.suppress(OSError):
                self._file.close()
            with contextlib.suppress(OSError):  # a disk that has gone can't be put right
                os.ftruncate(descriptor, self._good)
                os.fsync(descriptor)
                if self.is_empty and log_stream.is_at(descriptor, self.path):
                    self.path.unlink()
        finally:
            os.close(descriptor)
