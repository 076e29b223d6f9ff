"use strict";
// What every page of HRSI does beyond showing itself: tables are sorted by a click on a heading, and print is complete.
(() => {
  document.documentElement.classList.add("scripts");

  // ---- Sorting ----------------------------------------------------------------------------------------------------
  const sortValue = (cell) => {
    const shown = cell.dataset.value ?? cell.textContent.trim().replace(/[\u202f\u00a0]/g, "").replace(/\u2212/g, "-");
    const number = shown === "" || shown === "null" ? NaN : Number(shown);
    return Number.isNaN(number) ? shown : number;
  };
  const compare = (a, b) => {
    const dash = (value) => value === "null" || value === "–" || value === "";
    if (dash(a) || dash(b)) return dash(a) - dash(b); // what does not exist comes last
    if (typeof a === "number" && typeof b === "number") return a - b;
    return String(a).localeCompare(String(b), undefined, { numeric: true });
  };
  const sortTable = (table, column, heading) => {
    const descending = heading.getAttribute("aria-sort") === "ascending";
    for (const other of table.querySelectorAll("thead th")) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", descending ? "descending" : "ascending");
    const body = table.tBodies[0];
    const rows = [...body.rows].map((row) => [sortValue(row.cells[column]), row]);
    rows.sort(([a], [b]) => (descending ? compare(b, a) : compare(a, b)));
    body.append(...rows.map(([, row]) => row));
  };
  for (const table of document.querySelectorAll("table.sortable")) {
    table.querySelectorAll("thead th").forEach((heading, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...heading.childNodes);
      heading.append(button);
      button.addEventListener("click", () => sortTable(table, column, heading));
    });
  }

  // ---- Print: everything is shown, and afterwards as it was -------------------------------------------------------
  let closed = [];
  addEventListener("beforeprint", () => {
    closed = [...document.querySelectorAll("details:not([open])")];
    for (const part of closed) part.open = true;
  });
  addEventListener("afterprint", () => {
    for (const part of closed) part.open = false;
  });
})();
