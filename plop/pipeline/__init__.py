"""The runner: what a stage is, which there are, what a run needs first, and running it. It prints nothing."""
