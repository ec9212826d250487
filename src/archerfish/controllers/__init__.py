"""Controllers: they turn what is seen into commands.

`predictors` estimate where a target will be, `aiming` turns that into commands, `policy` is the trained controller.
`registry` builds all of them by name.
"""
