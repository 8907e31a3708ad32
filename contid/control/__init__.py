"""From targets to bus commands: four packages, each importing only those to its right.

    daemon  >  process  >  engine  >  tick

The path of a target::

    daemon.run               reads the request, checks the input, starts the control process, reports
    daemon.inputs            a trajectory read to its end, or the header of a live stream
    tick.preflight           every row checked against the models before anything moves
    daemon.daemon            supervises; sends a `RunSetup`, then `engine.messages` through `process.pipe`
    ---------------------------------------------------------------- process border
    process.control_process  waits for the deadlines of `process.pace`, calls the engine every period
    engine.engine            one cycle of all robots; `engine.virtual` runs it in virtual time
    engine.target_selector   which trajectory or stream each robot follows (`engine.sources`)
    engine.chain_monitor     synchronises the arms of a closed chain
    tick.robot_tick          pure function: target to device command (`model`, `limits`, `transmission`)
    engine.exchange          commands to every bus (`engine.ports`), samples back
    engine.pack_record       packs the tick into one record (`engine.tick_layout`)
    ---------------------------------------------------------------- shared memory
    process.ring             records and events, read by daemon, recorder, viewer and socket

`tick.supervisor` is the table of states, `tick.transitions` what orders and faults do in them, `tick.faults`
the table of faults.
"""
