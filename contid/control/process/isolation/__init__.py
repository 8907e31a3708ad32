"""A process per bus and per model of others: nothing that foreign code does costs the tick or another robot.

    control process  --fork, before real time-->  keeper  --fork, at every start-->  bus or model process
          |  requests and answers, by a deadline            (imports nothing foreign)
          +---------------------------------------------------------------------------->

The keeper reports how its process ended, limits and forwards what it prints and logs, and ends it with
everything that it started. Each of them ends with the process before it. The daemon has model processes too.
"""
