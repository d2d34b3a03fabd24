"""armsight: a robot arm that knows its surroundings.

Start with ``armsight --help`` or ``docs/index.md``. armsight is no certified safety function.
"""

__version__ = "0.1.0"
