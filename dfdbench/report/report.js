"use strict";
(() => {
  const BATCH = 24;
  const find = (selector, root = document) => Array.from(root.querySelectorAll(selector));
  const pictures = JSON.parse(document.getElementById("pictures").textContent);
  const pairs = find(".pair");
  const filters = find("[data-filter]");
  const more = document.getElementById("more");
  const count = document.getElementById("count");
  const view = document.getElementById("view");
  if (!pairs.length) return;
  const places = new Map(pairs.map((pair) => [pair, JSON.parse(pair.dataset.places)]));
  let limit = BATCH;

  const fill = (pair) => {
    for (const image of find("[data-picture]", pair)) {
      image.src = pictures[image.dataset.picture];
      image.removeAttribute("data-picture");
    }
  };

  const setError = (pair, shown) => {
    pair.classList.toggle("errors", shown);
    pair.querySelector(".toggle").setAttribute("aria-pressed", String(shown));
  };

  const update = () => {
    const wanted = filters.filter((filter) => filter.value);
    const fitting = pairs.filter((pair) =>
      wanted.every((filter) => places.get(pair)[filter.dataset.filter] === filter.value));
    const shown = new Set(fitting.slice(0, limit));
    for (const pair of pairs) {
      pair.hidden = !shown.has(pair);
      if (!pair.hidden) fill(pair);
    }
    more.hidden = fitting.length <= limit;
    const part = shown.size < fitting.length ? `${shown.size} of ` : "";
    count.textContent = `${part}${fitting.length} pairs`;
  };

  for (const pair of pairs) {
    const stage = pair.querySelector(".stage");
    pair.querySelector(".slider").addEventListener("input", (event) => {
      stage.style.setProperty("--split", `${event.target.value}%`);
    });
    pair.querySelector(".toggle").addEventListener("click", () => {
      setError(pair, !pair.classList.contains("errors"));
    });
  }
  for (const filter of filters) {
    filter.addEventListener("change", () => { limit = BATCH; update(); });
  }
  view.addEventListener("change", () => {
    for (const pair of pairs) setError(pair, view.value === "error");
  });
  more.addEventListener("click", () => { limit += BATCH; update(); });
  find(".filters").forEach((form) => form.addEventListener("submit", (event) => event.preventDefault()));
  window.addEventListener("beforeprint", () => find("details").forEach((part) => { part.open = true; }));
  update();
})();
