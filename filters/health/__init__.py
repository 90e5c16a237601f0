"""Channel health: faults of a sensor that its readings show, in a stream of any length and in bounded memory.

`monitor` takes every reading once and reports findings; the acquisition, `replay`, `check`, `trace` and campaigns use
the same one. It judges the sensor, never the filter: each detector compares readings with each other, with the size of
a count, or with the noise that the unit can have.

`standstill`: channels that stopped changing. `copies`: channels that repeat another one. `levels`: noise and drift of a
unit at rest. `values`: single values that are no readings. `finding`: what is reported.
"""
