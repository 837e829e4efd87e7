"use strict";
// Navigation that follows the reader, sortable and filterable tables, links that save figures and tables.
(() => {
  const links = [...document.querySelectorAll("nav a")];
  const sections = links.map(link => document.querySelector(link.getAttribute("href")));
  const follow = () => {
    const bottom = innerHeight + scrollY >= document.documentElement.scrollHeight - 2;
    let here = bottom ? sections.length - 1 : 0;
    if (!bottom) sections.forEach((section, k) => { if (section.getBoundingClientRect().top < 120) here = k; });
    links.forEach((link, k) => { link.classList.toggle("here", k === here); if (k === here) link.setAttribute("aria-current", "true"); else link.removeAttribute("aria-current"); });
  };
  addEventListener("scroll", follow, { passive: true });
  follow();

  const make = (tag, properties, ...children) => { const node = Object.assign(document.createElement(tag), properties); node.append(...children); return node; };

  const key = cell => { const raw = cell.dataset.raw ?? cell.textContent.trim(); const number = parseFloat(raw); return raw === "" || raw === "–" ? null : Number.isNaN(number) ? raw.toLowerCase() : number; };
  const compare = (a, b) => (a === null) - (b === null) || (typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b)));
  document.querySelectorAll("table.sortable").forEach(table => {
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      // No form control: Chromium leaves those out where a printed table repeats its head.
      const button = make("span", { className: "sort", tabIndex: 0, title: "Sort by this column" });
      button.setAttribute("role", "button");
      button.append(...head.childNodes);
      head.append(button);
      button.onkeydown = event => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); button.onclick(); } };
      button.onclick = () => {
        const down = head.getAttribute("aria-sort") === "ascending";
        [...table.tHead.rows[0].cells].forEach(other => other.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", down ? "descending" : "ascending");
        const body = table.tBodies[0];
        const rows = [...body.rows].map((row, place) => ({ row, place, key: key(row.cells[column]) }));
        rows.sort((a, b) => (a.key === null || b.key === null ? (a.key === null) - (b.key === null) : (down ? -1 : 1) * compare(a.key, b.key)) || a.place - b.place);
        body.append(...rows.map(item => item.row));
      };
    });
  });

  document.querySelectorAll("table.filterable").forEach(table => {
    const text = make("input", { type: "search", size: 28, placeholder: "Filter: LAD, FFR, crossfit …" });
    text.setAttribute("aria-label", "Filter the table");
    const only = make("input", { type: "checkbox" });
    const count = make("span", { className: "muted" });
    const apply = () => {
      const words = text.value.toLowerCase().split(/\s+/).filter(Boolean);
      let shown = 0;
      for (const row of table.tBodies[0].rows) {
        const cells = row.textContent.toLowerCase();
        row.hidden = (only.checked && !row.classList.contains("recommended")) || !words.every(word => cells.includes(word));
        shown += !row.hidden;
      }
      count.textContent = `${shown} of ${table.tBodies[0].rows.length} lines`;
    };
    text.oninput = only.onchange = apply;
    only.checked = true;
    const bar = make("div", { className: "filters" }, text, make("label", {}, only, " recommended only"), count);
    table.closest(".wide").before(bar);
    apply();
    addEventListener("beforeprint", () => { for (const row of table.tBodies[0].rows) row.hidden = false; });
    addEventListener("afterprint", apply);
  });

  document.querySelectorAll("figure img[data-file]").forEach(image => {
    const link = make("a", { className: "save", href: image.src, download: image.dataset.file, textContent: `Save ${image.dataset.file.split(".").pop().toUpperCase()}` });
    image.closest("figure").querySelector("figcaption").append(link);
  });

  addEventListener("beforeprint", () => document.querySelectorAll("details").forEach(details => { details.dataset.open = details.open; details.open = true; }));
  addEventListener("afterprint", () => document.querySelectorAll("details").forEach(details => { details.open = details.dataset.open === "true"; }));
})();
