// The page of all results: sortable tables, replays that start when they are seen.
"use strict";
function page() {
  const number = text => { const found = /-?\d+(\.\d+)?(e-?\d+)?/.exec(text); return found ? +found[0] : NaN; };
  for (const head of document.querySelectorAll("table.sorts th"))
    head.onclick = () => {
      const table = head.closest("table"), column = [...head.parentNode.children].indexOf(head);
      const order = head.dataset.order === "1" ? -1 : 1;
      for (const other of head.parentNode.children) delete other.dataset.order;
      head.dataset.order = order;
      const rows = [...table.tBodies[0].rows];
      const key = row => row.cells[column].textContent;
      rows.sort((a, b) => {
        const [x, y] = [number(key(a)), number(key(b))];
        if (isNaN(x) || isNaN(y)) return order * key(a).localeCompare(key(b));
        return order * (x - y);
      });
      table.tBodies[0].append(...rows);
    };

  // A replay is made when it comes into view.
  const begin = element => replay(element, JSON.parse(element.querySelector("script").textContent));
  const seen = new IntersectionObserver(entries => {
    for (const entry of entries.filter(e => e.isIntersecting)) {
      seen.unobserve(entry.target);
      begin(entry.target);
    }
  }, { rootMargin: "200px" });
  for (const element of document.querySelectorAll(".motion"))
    if (element.getBoundingClientRect().top < window.innerHeight) begin(element);
    else seen.observe(element);
}
