"""The tick, its limits and states, the control process and the daemon.

The way of a target, from where it comes in to the bus, module by module::

    run            a run from its `request` to its report: what is read, checked and started, in order
    inputs         a trajectory read to its end, or the header of a live stream
    preflight      every row asked of the models before anything moves
    daemon         supervises; hands over a `setup`, then `messages` through a pipe (`pipe`, `child`)
    ---------------------------------------------------------------- the process border
    process        waits for the deadlines of `pace` and turns the engine; `virtual` does it without waiting
    engine         one cycle: obeys messages, then for every robot
      course         what is followed (`sources`: a trajectory or a stream), and how a run ends
      chain_orders   arms of closed chains wait for each other (`chain_watch`)
      loop           target, `plan` and `state` to a command: model, `limits`, `transmission`; a pure function
      exchange       commands and what devices shall do, to every bus (`ports`), and samples back
      recording      what was seen and decided, as one `record`
    ---------------------------------------------------------------- shared memory
    ring           records and events, for the daemon (`account`, `terminal`), recorder, viewer and socket

States and the moves between them are in `supervisor` (the table) and `state` (what changes with them), what
can go wrong in `faults`.
"""
