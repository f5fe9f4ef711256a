"""The help option of every command."""

HELP = {"help_option_names": ["-h", "--help"]}
