"""The wire: MCAP logs and CDR messages to columns and back."""

from schemas.wire.append import append_tables
from schemas.wire.builder import Messages
from schemas.wire.definitions import defined, definition
from schemas.wire.reader import read_log, read_messages, scan_log
from schemas.wire.table import Attachment, ChannelInfo, Log, Table
from schemas.wire.writer import write_log

__all__ = [
    "Attachment",
    "ChannelInfo",
    "Log",
    "Messages",
    "Table",
    "append_tables",
    "defined",
    "definition",
    "read_log",
    "read_messages",
    "scan_log",
    "write_log",
]
