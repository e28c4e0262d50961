"""A user-mode Linux kernel with vcan0 for hosts whose own kernel has no SocketCAN."""
