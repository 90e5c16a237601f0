"""Style of a page: wide, narrow, light, dark, on paper. Colours of figures are named here once for each."""

STYLE = """
:root { color-scheme: light dark; --ink: #1c1c1c; --paper: #fff; --faint: #595959; --rule: #d8d8d8; --fill: #f3f4f6;
  --before: #c2530a; --after: #1b4f9c; --floor: #8a8a8a; --good: #e7f3ea; --warn: #fdf0d5 }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e6; --paper: #16181c; --faint: #a9adb5; --rule: #3a3f47;
  --fill: #22262c; --before: #f0954f; --after: #7fb2ff; --floor: #8a8f98; --good: #1d3325; --warn: #40310f } }
* { box-sizing: border-box }
body { font: 16px/1.5 system-ui, "DejaVu Sans", sans-serif; color: var(--ink); background: var(--paper);
  max-width: 64rem; margin: 0 auto; padding: 1.5rem 1rem 3rem; overflow-wrap: break-word }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 1rem 0 .6rem }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .6rem; padding-bottom: .25rem; border-bottom: 2px solid var(--rule) }
h3 { font-size: 1rem; margin: 1.2rem 0 .3rem }
h1, h2, h3 { break-after: avoid } ul, ol { margin: .3rem 0 1rem; padding-left: 1.6rem }
p, li { max-width: 48rem } li { margin: .35rem 0 }
a { color: var(--after) } article + article { margin-top: 4rem; border-top: 4px solid var(--rule) }
code, pre, td.code { font-family: ui-monospace, "DejaVu Sans Mono", monospace; font-size: .9em }
code { overflow-wrap: anywhere } pre { background: var(--fill); padding: .8rem; white-space: pre-wrap;
  overflow-wrap: anywhere }
td.code { font-size: 1em }
.origin { padding: .6rem .9rem; border-left: .4rem solid var(--floor); background: var(--fill); max-width: none }
.origin.simulated { border-color: var(--before); background: var(--warn) }
.origin.measured { border-color: var(--after); background: var(--good) }
dl { display: grid; grid-template-columns: minmax(9rem, max-content) minmax(0, 1fr); gap: .25rem 1.2rem;
  margin: .5rem 0 1rem }
dt { color: var(--faint) } dd { margin: 0; overflow-wrap: anywhere }
table { border-collapse: collapse; width: 100%; margin: .8rem 0 1.2rem; font-size: .92rem }
caption { text-align: left; color: var(--faint); padding-bottom: .4rem }
th { text-align: left; vertical-align: bottom; font-weight: 600; color: var(--faint) }
th, td { padding: .4rem .9rem .4rem 0; border-bottom: 1px solid var(--rule); vertical-align: top }
th.number, td.number { text-align: right; font-variant-numeric: tabular-nums } td.number { white-space: pre }
td.file, td.hash { font-family: ui-monospace, "DejaVu Sans Mono", monospace; font-size: .85em;
  overflow-wrap: anywhere }
td.file { min-width: 9rem } td.hash { min-width: 33ch; width: 33ch } code.short { white-space: nowrap }
td.bar { font-family: ui-monospace, "DejaVu Sans Mono", monospace; white-space: pre; color: var(--after);
  min-width: 6.5rem }
td:last-child, th:last-child { padding-right: 0 }
tr, svg, figcaption, figure, table { break-inside: avoid } summary { cursor: pointer }
figcaption, caption { break-after: avoid }
figure { margin: 1.6rem 0 } figcaption { margin-bottom: .5rem; max-width: 48rem; color: var(--faint) }
figcaption strong { color: var(--ink) }
.panels { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 21rem), 1fr)); gap: .8rem 1.2rem }
.panels svg { width: 100%; height: auto; display: block; color: var(--ink); max-width: 40rem }
@media screen and (max-width: 44rem) {
  body { padding: .75rem .9rem 2rem } dl { grid-template-columns: minmax(0, 1fr); gap: 0 } dd { margin-bottom: .5rem }
  thead { position: absolute; left: -999rem } table, tbody, tr, td, caption { display: block }
  tr { padding: .5rem 0; border-bottom: 1px solid var(--rule) } td, td.number, td.hash { border: 0; padding: .1rem 0;
  text-align: left; width: auto; min-width: 0; white-space: normal }
  tbody td:first-child { font-weight: 600 } td:empty { display: none }
  td::before { content: attr(data-label) ": "; color: var(--faint);
  font-family: system-ui, "DejaVu Sans", sans-serif }
}
@media print { :root { color-scheme: light; --ink: #000; --paper: #fff; --faint: #444; --rule: #bbb; --fill: #f3f4f6;
  --before: #c2530a; --after: #1b4f9c; --floor: #8a8a8a; --good: #e7f3ea; --warn: #fdf0d5 }
  article + article { break-before: page }
  body { font-size: 10.5pt; max-width: none; padding: 0 } h2 { margin-top: 1.4rem } table { font-size: 9pt }
  .panels { grid-template-columns: 1fr 1fr } .panels svg:only-child { max-width: 12cm }
  .origin { print-color-adjust: exact; -webkit-print-color-adjust: exact } }
@page { size: A4; margin: 16mm 15mm 18mm }
"""
