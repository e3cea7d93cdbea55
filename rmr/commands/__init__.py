"""The subcommands of `rmr` that are this package's own: the module `X_command` holds the `command` of `rmr X`.

`subcommands` has their names and imports a module when its name is called. A module imports the compiler, and
anything else that is heavy, inside of its functions, so that the help of a command loads neither.
"""
