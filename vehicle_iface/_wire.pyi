from collections.abc import Callable
from typing import final

from vehicle_iface.decoded import DecodedMessage
from vehicle_iface.frame import CanFrame

SOURCE_CRC32: str

@final
class FrameReceiver:
    def __new__(cls, descriptor: int, frame_type: type[CanFrame], bus: int, /) -> FrameReceiver: ...
    def receive(self, wait: bool, /) -> int: ...
    def take(self, inbox: list[CanFrame], offset_ns: int, now_ns: int, /) -> int: ...

@final
class FrameSender:
    def __new__(cls, descriptor: int, pack: Callable[[CanFrame], bytes], /) -> FrameSender: ...
    def send(self, frames: tuple[CanFrame, ...], /) -> int: ...

@final
class Packer:
    def __new__(cls, base: bytes, fields: tuple[object, ...], counter: object, checksum: object, /) -> Packer: ...
    def pack(self, values: object, counter: int, /) -> bytes | None: ...

@final
class Unpacker:
    def __new__(
        cls,
        message_type: type[DecodedMessage],
        name: str,
        length: int,
        is_fd: bool,
        inputs: tuple[object, ...],
        counter: object,
        checksum: object,
        /,
    ) -> Unpacker: ...
    def unpack(self, frame: CanFrame, counter: int, /) -> DecodedMessage | None: ...
