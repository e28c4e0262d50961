"""What the bench catches: defects of two controllers, and the cases that fail for them."""
