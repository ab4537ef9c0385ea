"""What the mock PX4 answers who asks for files: MAVLink FTP over an empty, read-only disk.

A client that probes for component metadata or logs is refused at once instead of being left to
its timeouts. Opcodes and errors are MAVLink FTP's.
"""

import struct

from pymavlink.dialects.v20 import development as mavlink

from hal.sim.mock_px4_streams import Message

_HEADER = struct.Struct("<HBBBBBxI")  # seq, session, opcode, size, asked opcode, burst done, offset
_PAYLOAD_BYTES, _DATA_BYTES = 251, 239
_ACK, _NAK = 128, 129
_NOTHING, _TERMINATE, _RESET, _LIST = 0, 1, 2, 3
_LOOKS = frozenset({4, 14, 15})  # open to read, checksum, burst read
_READS = frozenset({5})
_CHANGES = frozenset({6, 7, 8, 9, 10, 11, 12, 13})
_INVALID_SESSION, _END_OF_FILE, _UNKNOWN_COMMAND, _PROTECTED, _NOT_FOUND = 4, 6, 7, 9, 10


def file_answer(message: Message) -> list[Message]:
    """The answer to one FILE_TRANSFER_PROTOCOL message; nothing for one that is an answer."""
    request = bytes(message.payload[:_PAYLOAD_BYTES])
    seq, session, opcode, size, _, _, offset = _HEADER.unpack_from(request)
    if opcode in (_ACK, _NAK):
        return []
    path = request[_HEADER.size : _HEADER.size + min(size, _DATA_BYTES)].rstrip(b"\0")
    error = _error(opcode, path)
    data = b"" if error == 0 else bytes([error])
    header = _HEADER.pack(
        (seq + 1) & 0xFFFF, session, _NAK if error else _ACK, len(data), opcode, 0, offset
    )
    payload = (header + data).ljust(_PAYLOAD_BYTES, b"\0")
    return [
        mavlink.MAVLink_file_transfer_protocol_message(
            0, message.get_srcSystem(), message.get_srcComponent(), list(payload)
        )
    ]


def _error(opcode: int, path: bytes) -> int:
    """The error of a request on a disk that holds nothing and takes nothing; 0 for none."""
    if opcode in (_NOTHING, _RESET):
        return 0
    if opcode == _LIST:
        return _END_OF_FILE if path in (b"", b"/") else _NOT_FOUND
    if opcode in _LOOKS:
        return _NOT_FOUND
    if opcode in _READS or opcode == _TERMINATE:
        return _INVALID_SESSION
    return _PROTECTED if opcode in _CHANGES else _UNKNOWN_COMMAND


def no_logs(_message: Message) -> list[Message]:
    """The answer to LOG_REQUEST_LIST: there are none."""
    return [mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0)]
