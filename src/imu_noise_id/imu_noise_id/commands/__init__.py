"""Commands: parse, call the core, print.  One module a command, one handler for what goes wrong."""
