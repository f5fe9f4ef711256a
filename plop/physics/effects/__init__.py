"""The library of physical effects: one file each; `library` finds them by name."""
