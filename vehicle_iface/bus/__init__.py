"""Whatever carries the frames: `base` is the seam, the others are its kinds."""
