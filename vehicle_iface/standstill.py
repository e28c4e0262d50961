"""Speeds at and below which a vehicle stands, by what depends on it. Speeds are magnitudes in m/s."""

AT_REST_MPS = 0.01
"""For the release: two counts of the reference vehicle's speed signal. A vehicle that still rolls keeps its brake."""
STANDING_MPS = 0.05
"""For a measured speed: up to here it may be a sensor's offset at rest, and its sign means nothing."""
CREEPING_MPS = 0.1
"""For planning and lateral limits: slower than this no wheel angle can be felt, v² must not be divided by, and a
vehicle that should stand has arrived."""
