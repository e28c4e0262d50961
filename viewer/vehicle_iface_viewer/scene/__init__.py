"""The scene: ground, trajectory, markers, vehicle and its trail.

Every node is created once and updated through its handle. Positions are relative to a local origin near the vehicle,
because viser drops an update that differs by less than a hundred-thousandth of the value.

Each browser has its own copy of the frame `ROOT`, the parent of all nodes. Following the vehicle moves that frame under
a camera that stays the user's own, so following does not interfere with turning and zooming. Below it are the scene of
the present, which a running loop has once for all browsers, and that of the past, which a browser has when it looks
back.
"""
