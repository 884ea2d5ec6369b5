#include "sfm/report_style.h"

namespace rotunda::sfm::report {

std::string_view StyleSheet() {
  return R"css(
:root{color-scheme:light dark;--paper:#f6f7f9;--card:#ffffff;--ink:#14181f;--soft:#5b6472;--line:#e1e5ea;--faint:#eef0f3;
--accent:#2f6bbe;--good:#13805a;--good-bg:#e7f5ee;--look:#a86500;--look-bg:#fdf3e0;--bad:#c62f35;--bad-bg:#fdebec;--unknown:#5b6472;--unknown-bg:#eef0f3;
--q0:#a9cbf5;--q1:#86b2ec;--q2:#6598df;--q3:#467ecd;--q4:#2c64b4;--q5:#194b95;--q6:#0a3170}
@media screen and (prefers-color-scheme:dark){:root{--paper:#0e1116;--card:#161a21;--ink:#e8ebf0;--soft:#98a2b1;--line:#2a303a;--faint:#1e232c;
--accent:#7fb0f5;--good:#3fbf8b;--good-bg:#12291f;--look:#e5a63c;--look-bg:#2d2210;--bad:#ff6b70;--bad-bg:#341619;--unknown:#98a2b1;--unknown-bg:#1e232c;
--q0:#234a83;--q1:#2f60a6;--q2:#4079c6;--q3:#5c95e0;--q4:#82b2f0;--q5:#adcef8;--q6:#dceafe}}
*{box-sizing:border-box}
html{scroll-behavior:smooth;scroll-padding-top:3.2rem}
body{margin:0;background:var(--paper);color:var(--ink);font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif;font-variant-numeric:tabular-nums}
main,header,footer{max-width:1360px;margin:0 auto;padding:0 28px}
header{padding-top:26px;display:flex;flex-wrap:wrap;align-items:baseline;gap:4px 18px}
header h1{font-size:1.45rem;font-weight:650;letter-spacing:-.01em;margin:0;overflow-wrap:anywhere}
header p{margin:0;color:var(--soft)}
h2{font-size:1.02rem;font-weight:650;margin:0}
section{margin:30px 0}
.head{display:flex;flex-wrap:wrap;align-items:center;justify-content:space-between;gap:8px 20px;margin-bottom:12px}
.head p{margin:0;color:var(--soft);font-size:.87rem}
.card{background:var(--card);border:1px solid var(--line);border-radius:10px}
.verdicts{display:grid;grid-template-columns:3fr 2fr;gap:14px;margin:18px 0 14px}
.verdict{padding:16px 20px 15px 18px;border-left:6px solid;border-radius:10px;overflow-wrap:anywhere}
.verdict.good{background:var(--good-bg);border-color:var(--good)}.verdict.look{background:var(--look-bg);border-color:var(--look)}
.verdict.bad{background:var(--bad-bg);border-color:var(--bad)}.verdict.unknown{background:var(--unknown-bg);border-color:var(--unknown)}
.verdict .mark{font-size:.78rem;font-weight:700;letter-spacing:.06em;text-transform:uppercase}
.good .mark{color:var(--good)}.look .mark{color:var(--look)}.bad .mark{color:var(--bad)}.unknown .mark{color:var(--unknown)}
.verdict h2{font-size:1.32rem;line-height:1.3;letter-spacing:-.01em;margin:2px 0 4px}
.verdict p{margin:2px 0 0}
.tiles{display:flex;flex-wrap:wrap;gap:1px;background:var(--line);overflow:hidden}
.tile{flex:1 1 166px;background:var(--card);padding:12px 14px 13px}
.tile dt{color:var(--soft);font-size:.84rem}
.tile dd{margin:0}
.tile .figure{font-size:1.5rem;font-weight:620;letter-spacing:-.015em;line-height:1.3}
.tile .figure small{font-size:.9rem;font-weight:500;color:var(--soft);letter-spacing:0}
.tile .more{color:var(--soft);font-size:.84rem;overflow-wrap:anywhere}
.tiles,.tile{margin:0}
.by{display:inline-flex;flex-wrap:wrap;border:1px solid var(--line);border-radius:8px;overflow:hidden;background:var(--card)}
.by button{font:inherit;font-size:.87rem;padding:5px 12px;border:0;border-right:1px solid var(--line);background:none;color:var(--soft);cursor:pointer}
.by button:last-child{border-right:0}
.by button[aria-pressed=true]{background:var(--accent);color:var(--card);font-weight:600}
.legend{display:none;flex-wrap:wrap;align-items:center;gap:2px 7px;font-size:.86rem;color:var(--soft)}
.legend i{display:inline-block;width:18px;height:11px;background:var(--c)}
.legend span{white-space:nowrap}
.legend.state i{width:11px;border-radius:3px;margin:0 7px 0 9px}
.legend i.hollow{background:none;border:1.6px dashed var(--bad)}
.legend .ramp{display:inline-flex}
.views{display:grid;grid-template-columns:1fr 1fr;gap:14px}
.views figure{margin:0;padding:6px 6px 0;display:flex;flex-direction:column}
.views .wide{grid-column:1/-1;padding:6px 12px}
figcaption{padding:8px 12px 2px;font-size:.87rem;color:var(--soft)}
figcaption b{color:var(--ink);font-weight:600}
svg{display:block;width:100%;height:auto;overflow:hidden}
.view{margin:auto 0;max-height:820px}
svg text{font-family:inherit}
.label,.cell{font-size:12px;fill:var(--soft)}
.mid{text-anchor:middle}.end{text-anchor:end}
.ring{fill:none;stroke:var(--line);stroke-width:1.2}
.tick,.scale,.arrow{fill:none;stroke:var(--soft);stroke-width:1.3}
.arrow{stroke-width:1.6;stroke-linecap:round}
.points path{fill:none;stroke-width:2.3;stroke-linecap:round}
.cam{--c:var(--accent);fill:var(--c);stroke:var(--c);cursor:pointer;text-decoration:none}
.cam.look{--c:var(--look)}.cam.bad{--c:var(--bad)}
.view .cam path{fill-opacity:.13;stroke-width:1;stroke-opacity:.8;stroke-linejoin:round}
.view .cam.look path,.view .cam.bad path{stroke-width:1.7;fill-opacity:.3;stroke-opacity:1}
.view .cam.missing path,.map .cam.missing rect{stroke-dasharray:3 2.5;fill-opacity:.06;stroke-width:1.6}
body:not([data-by=state]) .map .cam:not(.missing) rect{fill-opacity:.85}
body:not([data-by=state]) .map .cell{paint-order:stroke;stroke:var(--card);stroke-width:3px}
.map .cam.missing .cell{fill:var(--bad)}
.astray{fill:none;stroke-width:2.4}
.before path{fill:none;stroke:var(--bad);stroke-width:1.1;stroke-dasharray:2 2}
.map .cam rect{stroke-width:1.2;fill-opacity:.16}
.map .cam.bad rect,.map .cam.look rect{fill-opacity:.3;stroke-width:2}
.map .cell{stroke:none;fill:var(--ink)}
.map .cam.bad .cell,.map .cam.look .cell{font-weight:700}
.bars .cam rect{stroke:none}
.bars .cam .absent{fill:var(--bad);fill-opacity:.13}
.bars .grid{stroke:var(--line)}.bars .base{stroke:var(--soft)}.bars .median{stroke:var(--ink);stroke-dasharray:3 4;opacity:.55}
.bars .grid,.bars .base,.bars .median{fill:none;stroke-width:1}
.chart-title{font-size:12.5px;font-weight:600;fill:var(--ink)}
.bar-name{font-size:9.5px;fill:var(--soft);text-anchor:end}
.chart{padding:16px 18px 12px}
.cam.hot{--c:var(--ink)}
.view .cam.hot path{stroke-width:2.2;fill-opacity:.45;stroke-opacity:1}
.map .cam.hot rect{stroke-width:2.6}
.scroll{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-size:.9rem}
th,td{padding:5px 10px;text-align:right;white-space:nowrap;border-top:1px solid var(--line)}
thead th{border-top:0;padding:0;font-weight:600;vertical-align:bottom;position:sticky;top:0;background:var(--card);box-shadow:0 1px 0 var(--line);z-index:1}
thead button{font:inherit;font-size:.84rem;line-height:1.25;color:var(--soft);width:100%;padding:9px 10px;white-space:normal;border:0;background:none;cursor:pointer;text-align:inherit}
thead small{display:block;font-weight:400}
th[aria-sort] button{color:var(--ink)}
th[aria-sort=ascending] button span::after{content:" ▲"}th[aria-sort=descending] button span::after{content:" ▼"}
.left{text-align:left}
td.notes{white-space:normal;min-width:15rem;overflow-wrap:anywhere}
tbody th{font-weight:600;text-align:left}
tbody tr:hover,tbody tr.hot{background:var(--faint)}
tr.look{background:var(--look-bg)}tr.bad{background:var(--bad-bg)}
tr:target{outline:2px solid var(--accent);outline-offset:-2px}
.pill{display:inline-block;width:9px;height:9px;border-radius:50%;margin-right:9px;background:var(--accent)}
tr.look .pill{background:var(--look)}tr.bad .pill{background:var(--bad)}tr.missing .pill{background:none;box-shadow:inset 0 0 0 2px var(--bad)}
.bar{display:inline-block;width:40px;height:6px;margin-left:8px;border-radius:3px;background:var(--faint);vertical-align:middle;overflow:hidden}
.bar i{display:block;height:100%;background:var(--accent);border-radius:3px}
tr.look .bar,tr.bad .bar{background:var(--line)}
.strip{display:grid;grid-template-columns:repeat(auto-fill,minmax(88px,1fr));gap:10px 8px;align-items:end}
.strip a{display:block;color:inherit;text-decoration:none;font-size:.8rem;text-align:center;overflow-wrap:anywhere}
.strip img,.strip .none{display:block;width:100%;height:auto;border-radius:5px;margin-bottom:2px;background:var(--faint)}
.strip .none{aspect-ratio:3/4;display:grid;place-items:center;padding:6px;color:var(--soft);font-size:.75rem}
.strip .look img,.strip .look .none{outline:3px solid var(--look)}.strip .bad img,.strip .bad .none{outline:3px solid var(--bad)}
.strip .bad{color:var(--bad);font-weight:600}.strip .look{color:var(--look);font-weight:600}
.strip a.hot img{outline:3px solid var(--accent)}
.page{display:block;width:100%;height:90vh;border:1px solid var(--line);border-radius:8px}
footer{color:var(--soft);font-size:.86rem;padding-bottom:40px}
footer dl{display:flex;flex-wrap:wrap;gap:3px 24px;margin:0;border-top:1px solid var(--line);padding-top:14px}
footer div{overflow-wrap:anywhere}
footer dt,footer dd{display:inline;margin:0}
footer dd{color:var(--ink)}
@media(max-width:860px){.verdicts,.views{grid-template-columns:1fr}main,header,footer{padding-left:14px;padding-right:14px}}
@media print{@page{margin:12mm}
*{print-color-adjust:exact;-webkit-print-color-adjust:exact}
html{font-size:10px}body{background:#fff;font-size:1rem}.scroll{overflow:visible}main,header,footer{max-width:none;padding:0}
section{margin:16px 0}.by{display:none}thead th{position:static}th,td{padding:2px 6px}thead button{padding:3px 6px}
figure,tr,.strip a,.verdict,.tile{break-inside:avoid}
.verdicts{grid-template-columns:3fr 2fr}.views{grid-template-columns:1fr 1fr}
.strip{grid-template-columns:repeat(15,1fr);gap:5px}.bar{width:26px;margin-left:5px}td.notes{min-width:11rem}}
)css";
}

std::string_view Script() {
  return R"js(
(function(){
  const all = (selector, root) => Array.from((root || document).querySelectorAll(selector));
  const body = document.body;

  all(".by button").forEach(button => button.addEventListener("click", () => {
    body.dataset.by = button.dataset.by;
    all(".by button").forEach(other => other.setAttribute("aria-pressed", String(other === button)));
  }));

  const marked = new Map();
  all("[data-cam]").forEach(element => {
    const camera = element.dataset.cam;
    if (!marked.has(camera)) marked.set(camera, []);
    marked.get(camera).push(element);
    const mark = on => () => marked.get(camera).forEach(other => other.classList.toggle("hot", on));
    element.addEventListener("mouseenter", mark(true));
    element.addEventListener("mouseleave", mark(false));
  });

  const value = (row, column) => row.children[column].dataset.v;
  const compare = (a, b) => {
    const x = Number(a), y = Number(b);
    return isNaN(x) || isNaN(y) ? a.localeCompare(b, "en", {numeric: true}) : x - y;
  };
  all("thead button").forEach((button, column) => button.addEventListener("click", () => {
    const head = button.parentNode, rows = document.querySelector("tbody");
    const up = head.getAttribute("aria-sort") === "descending" ? true
             : head.getAttribute("aria-sort") === "ascending" ? false : head.dataset.first !== "down";
    all("thead th").forEach(other => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    all("tr", rows).sort((a, b) => {
      const x = value(a, column), y = value(b, column);
      if (x === "" || y === "") return (x === "") - (y === "");
      return up ? compare(x, y) : compare(y, x);
    }).forEach(row => rows.appendChild(row));
  }));
})();
)js";
}

}  // namespace rotunda::sfm::report
