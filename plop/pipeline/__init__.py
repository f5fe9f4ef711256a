"""The runner: definition and registry of stages, planning and execution of runs. It prints nothing."""
