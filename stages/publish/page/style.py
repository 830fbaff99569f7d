"""How a page looks, on the screen and on paper."""

STYLE = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
html { -webkit-print-color-adjust: exact; print-color-adjust: exact; }
body { margin: 0 auto; padding: 2.2rem 1.6rem 3rem; max-width: 60rem; background: #fff; color: #1c2128;
  font: 15px/1.5 "Inter", "Segoe UI", "Helvetica Neue", "DejaVu Sans", Arial, sans-serif; }
header .kind { margin: 0; color: #667080; font-size: .78rem; letter-spacing: .09em; text-transform: uppercase; }
h1 { margin: .1rem 0 .2rem; font-size: 1.75rem; line-height: 1.2; overflow-wrap: anywhere; }
header .about { margin: 0 0 1.2rem; color: #4a5361; }
h2 { margin: 2.2rem 0 .6rem; padding-bottom: .25rem; border-bottom: 1px solid #d6dbe1; font-size: 1.15rem; }
h3 { margin: 1.2rem 0 .4rem; font-size: .98rem; }
p { margin: .4rem 0; max-width: 48rem; }
.verdict { margin: 1rem 0 1.4rem; padding: .9rem 1.1rem; border-left: 6px solid #8a8f98; background: #f4f6f8; }
.verdict p { max-width: none; }
.verdict .grade { margin: 0 0 .3rem; font-size: 1.12rem; font-weight: 650; }
.verdict ul { margin: .4rem 0 0; }
.verdict.good { border-color: #1d8a4b; background: #eff8f2; } .verdict.good .grade { color: #14683a; }
.verdict.care { border-color: #d79a12; background: #fdf7e8; } .verdict.care .grade { color: #855d00; }
.verdict.bad { border-color: #c0352f; background: #fdf0ef; } .verdict.bad .grade { color: #98241f; }
ul { margin: .4rem 0; padding-left: 1.2rem; } li { margin: .15rem 0; overflow-wrap: anywhere; }
.table { overflow-x: auto; margin: .7rem 0 1rem; }
table { border-collapse: collapse; font-size: .87rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; padding-bottom: .3rem; color: #4a5361; }
th, td { padding: .24rem .8rem .24rem 0; text-align: right; vertical-align: top; }
th:first-child, td.text { text-align: left; }
thead th { border-bottom: 1.5px solid #8a8f98; font-weight: 600; color: #3b4350; }
tbody th { font-weight: 500; white-space: nowrap; } tbody tr { border-bottom: 1px solid #e7eaee; }
table.words td, table.words thead th, table.listing td, table.listing thead th { text-align: left; }
table.listing td:not(:last-child) { white-space: nowrap; } table.words td { overflow-wrap: break-word; }
figure { margin: .9rem 0 1.2rem; break-inside: avoid; }
figure svg { display: block; width: 100%; height: auto; }
figcaption { display: flex; flex-wrap: wrap; gap: .1rem 1rem; align-items: baseline;
  font-size: .84rem; color: #3b4350; }
figcaption strong { margin-right: auto; color: #1c2128; }
figcaption span { white-space: nowrap; }
figure svg.key { display: inline-block; width: 1.1rem; height: .7rem; margin-right: .35rem; }
.row { display: grid; grid-template-columns: repeat(3, 1fr); gap: 0 1rem; }
.row figcaption strong { width: 100%; }
.row.two { grid-template-columns: repeat(2, 1fr); }
svg text { font: 10.5px "Inter", "Segoe UI", "Helvetica Neue", "DejaVu Sans", Arial, sans-serif; fill: #4a5361; }
svg text.label { fill: #1c2128; } svg .mid { text-anchor: middle; } svg .end { text-anchor: end; }
svg .grid { stroke: #e4e8ec; stroke-width: .8; fill: none; }
svg .frame { fill: none; stroke: #9aa2ad; stroke-width: .9; }
svg .zone { fill: #c0352f; fill-opacity: .13; } svg path { stroke-linejoin: round; }
svg .whisker { stroke: #1c2128; stroke-width: 1.1; fill: none; } svg .mark { stroke: #c0352f; stroke-width: 1.6; }
.note { color: #4a5361; font-size: .87rem; }
.mono { font-family: "DejaVu Sans Mono", Consolas, monospace; font-size: .82rem; overflow-wrap: anywhere; }
pre { padding: .7rem .9rem; background: #f4f6f8; font: .78rem/1.45 "DejaVu Sans Mono", Consolas, monospace;
  white-space: pre-wrap; overflow-wrap: anywhere; }
footer { margin-top: 2.4rem; border-top: 1px solid #d6dbe1; color: #667080; font-size: .8rem; }
@page { size: A4; margin: 15mm 14mm 16mm;
  @bottom-right { content: counter(page) " / " counter(pages); font: 8pt sans-serif; color: #667080; } }
@media print {
  body { padding: 0; max-width: none; font-size: 10pt; } h1 { font-size: 17pt; } .table { overflow: visible; }
  h2, h2 + p, h3, figcaption { break-after: avoid; } figure { margin: .6rem 0 .8rem; }
  tr, .table, .verdict, figure { break-inside: avoid; } a { color: inherit; }
}
"""
