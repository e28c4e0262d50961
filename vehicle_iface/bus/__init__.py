"""CAN buses: `base` is the interface, the other modules implement it."""
