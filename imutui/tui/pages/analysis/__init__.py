"""Analysis: Allan deviation, spectrum and histogram of one channel, over all packets of the acquisition."""
