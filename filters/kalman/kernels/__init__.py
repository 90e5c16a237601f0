"""The step of `spkf`, compiled: equations (1)-(5), (11)-(15) and (10) over 32 lanes, and the loop over samples.

The same mathematics as `strapdown` and `spkf`, which are written to be read; a test holds the two together. What is
different here is there for speed: 31 sigma points and a spare in 32 lanes of flat arrays with constant offsets, so
that each loop runs as vector instructions; quaternions and short series instead of sines, which the 0.2 rad of a
substep allow; biases, which have no dynamics, left out of the propagation; and one scalar update a row, which needs no
inverse. `fastmath` stays off: it may drop the very terms that keep rounding harmless.

`arithmetic` rows of 16 numbers, quaternions, the Earth · `lanes` prediction of all sigma points · `correction` the
update · `extra_states` those of effects · `step` the loop over samples, the only function that Python calls.

The arrays are laid out as `filters.kalman.layout` says.

What compiling costs grows with the number of operations in the source, so what stands twice is a function. Only
`step.advance` is kept on disk; it holds all the others. Numba looks whether its file has changed; that no other file
has that takes part is looked at by `step` itself. What effects need is compiled when effects are there.
"""
