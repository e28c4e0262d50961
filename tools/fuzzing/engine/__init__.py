"""What runs a target: the fuzzer, its verdicts, and makers of inputs."""
