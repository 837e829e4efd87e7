// What a reader would complain of on an open page: each function returns a list of lines, empty if all is well.
const overlaps = () => {
  const boxes = [...document.querySelectorAll('.card, figure, section > .wide, h2, h3')].filter(e => e.offsetParent !== null)
    .map(e => [e, e.getBoundingClientRect()]);
  const found = [];
  boxes.forEach(([a, p], i) => boxes.slice(i + 1).forEach(([b, q]) => {
    if (a.contains(b) || b.contains(a)) return;
    const w = Math.min(p.right, q.right) - Math.max(p.left, q.left), h = Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top);
    if (w > 1 && h > 1) found.push(`${a.tagName} ${a.id} ${a.textContent.slice(0, 30)} | ${b.tagName} ${b.id} ${b.textContent.slice(0, 30)}`);
  }));
  return found;
};

const clipped = () => [...document.querySelectorAll('.card, .card *, .conclusions li, figcaption, header *')]
  .filter(e => !e.closest('svg') && getComputedStyle(e).display !== 'inline' && e.scrollWidth > e.clientWidth + 1)
  .map(e => e.tagName + ' ' + e.className + ' ' + e.textContent.slice(0, 40));

const empty = () => [...document.querySelectorAll('figure img')].filter(i => !(i.complete && i.naturalWidth > 100 && i.clientHeight > 60))
  .map(i => i.alt);

const contrast = () => {
  const parse = text => { const n = text.match(/[\d.]+/g).map(Number); return n.length > 3 ? n : [...n, 1]; };
  const light = c => { const [r, g, b] = c.map(x => { x /= 255; return x <= 0.03928 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4; });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  const behind = e => { for (; e; e = e.parentElement) { const c = parse(getComputedStyle(e).backgroundColor); if (c[3] > 0.9) return c; }
    return parse(getComputedStyle(document.documentElement).backgroundColor)[3] > 0.9 ? parse(getComputedStyle(document.documentElement).backgroundColor) : [255, 255, 255]; };
  const bad = new Set();
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const e = walk.currentNode.parentElement, style = getComputedStyle(e);
    if (!walk.currentNode.textContent.trim() || !e.getClientRects().length || e.closest('script, style, noscript')) continue;
    const ink = parse(e.closest('svg') ? style.fill : style.color).slice(0, 3), ground = behind(e).slice(0, 3);
    const [a, b] = [light(ink), light(ground)].sort((x, y) => y - x), ratio = (a + 0.05) / (b + 0.05);
    const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && parseInt(style.fontWeight) >= 700);
    if (ratio < (large ? 3 : 4.5)) bad.add(`${ratio.toFixed(2)} ${e.tagName}.${e.className} ${walk.currentNode.textContent.trim().slice(0, 30)}`);
  }
  return [...bad];
};

const wide = () => [...document.querySelectorAll('table')].filter(t => t.scrollWidth > document.body.clientWidth + 1)
  .map(t => t.textContent.slice(0, 40));
