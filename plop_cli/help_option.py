"""How help is asked for, in every command."""

HELP = {"help_option_names": ["-h", "--help"]}
