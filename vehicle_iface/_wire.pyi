from collections.abc import Callable
from typing import final

from vehicle_iface.frame import CanFrame

SOURCE_SHA256: str

@final
class FrameReceiver:
    def __new__(cls, descriptor: int, frame_type: type[CanFrame], bus: int, /) -> FrameReceiver: ...
    def receive(self, wait: bool, /) -> int: ...
    def take(self, inbox: list[CanFrame], offset_ns: int, now_ns: int, /) -> int: ...

@final
class FrameSender:
    def __new__(cls, descriptor: int, pack: Callable[[CanFrame], bytes], /) -> FrameSender: ...
    def send(self, frames: tuple[CanFrame, ...], /) -> int: ...
