"""A process per bus, for drivers of others: nothing that a driver does costs the tick or another bus.

    control process  --fork, before real time-->  keeper  --fork, at every opening-->  bus process
          |  samples and commands, by a deadline              (imports no driver)       (imports the driver)
          +---------------------------------------------------------------------------->

The keeper reports how its bus process ended, limits and forwards what it prints and logs, and ends it with
everything that it started. Each of them ends with the process before it.
"""
