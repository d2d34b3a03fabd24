"""The subcommands of ``armsight``: one frozen dataclass each, whose fields are its arguments.

These modules import nothing heavy at the top: ``armsight --help`` answers at once.
"""
