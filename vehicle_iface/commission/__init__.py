"""A guided walk on a live bus: the person in the vehicle moves it, and each signal is compared with what was asked for.

A drive can only show that signals contradict one another; a profile of which everything is mirrored is consistent in
itself. The walk knows which way the wheel was turned. `readings` decodes the frames, `steps` says what is asked of
whom, `motion_checks` and `status_checks` judge, `walk` goes through it, `frame_log` records, `report` writes the
result. Nothing here can send a frame: `walk.Listener` is a bus without `send`.
"""
