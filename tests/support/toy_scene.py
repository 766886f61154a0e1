"""A scene of toy plugins (fixture `toys`), which has no physics."""

HEAD = """\
format: 1
bodies:
  a: {use: ball, mass: 1}
time: {end: 1.0, step: 1e-3}
integrator: still
"""
TOY_SCENE = HEAD + "reducer: {use: tuned, sampler: {use: grid, mix: 0.25}, budgets: {a: 5}}\n"
