"""What tests share: a client without an acquisition, loop-back lines, runs with known truth, pilots of the screen."""
