"""The subcommands of `rmr` that are this package's own, one module each.

`group` imports them when their name is called. A module holds one click command called `command`. Listing the
commands imports all of these modules, so each imports the compiler and anything else that is heavy inside of its
functions.
"""
