/* The leaderboard's page: choose, sort, filter; depth maps side by side; accuracy against seconds.
   The address keeps what is chosen: ?set=&protocol=&given=&method=&sort=&left=&right= */
"use strict";

(() => {
  const place = document.getElementById("board");
  const source = document.getElementById("board-data");
  if (!place || !source) return;
  const { boards, drawn } = JSON.parse(source.textContent);
  const asked = new URLSearchParams(location.search);

  const element = (name, attributes = {}, ...children) => {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  };
  const svg = (name, attributes, ...children) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  };
  const chooser = (label, values) => {
    const select = element("select", { "aria-label": label });
    for (const value of values) select.append(element("option", { value }, value));
    return [element("label", {}, label, select), select];
  };

  const sets = [...new Set(boards.map((board) => board.set))];
  const [setLabel, chosenSet] = chooser("data set", sets);
  const [protocolLabel, chosenProtocol] = chooser("protocol", []);
  const [givenLabel, chosenGiven] = chooser("given", []);
  const words = element("input", { type: "search", placeholder: "graph-cuts", "aria-label": "method" });
  const wordsLabel = element("label", {}, "method", words);
  const count = element("p", { class: "board-count", role: "status" });
  const holder = element("div", { class: "board-table", tabindex: "0", role: "region", "aria-label": "ranking" });
  const plot = element("div", { class: "board-plot" });
  const machines = element("p", { class: "board-count" });
  const maps = element("div", { class: "board-maps" });
  const mapsTitle = element("h2", { id: "depth-maps" }, "Depth maps side by side");
  let sorted = { column: 0, falls: false };

  const board = () =>
    boards.find((one) => one.set === chosenSet.value && one.protocol === chosenProtocol.value);
  const number = (value) => (value === null ? "–" : value.toFixed(4));
  const seconds = (value) =>
    value === null ? "–" : value < 0.001 ? "< 0.001" : value.toFixed(3);

  const score = (metric, at) => ({
    title: metric.title,
    of: (row) => row.scores[at],
    text: (row) => number(row.scores[at]),
    right: true,
    falls: metric.falls,
  });
  // The score that ranks stands before what a phone has no room for.
  const columns = () => [
    { title: "", of: (row) => row.rank, text: (row) => row.rank ?? "–", right: true },
    { title: "method", of: (row) => row.method, text: (row) => row.method, cell: (row) => named(row) },
    score(board().metrics[0], 0),
    { title: "given", of: (row) => row.given, text: (row) => row.given },
    ...board().metrics.slice(1).map((metric, at) => score(metric, at + 1)),
    { title: "seconds per pair", of: (row) => row.seconds, text: (row) => seconds(row.seconds), right: true },
    { title: "version", of: (row) => row.version, text: (row) => row.version },
  ];
  const named = (row) => [
    element("a", { href: `../method/${row.method}/` }, row.method),
    element(
      "details",
      {},
      element("summary", {}, "how"),
      element("code", {}, row.command),
      element("a", { href: row.file }, "scores of every pair"),
    ),
  ];

  const refill = (select, values) => {
    const before = select.value;
    select.replaceChildren(...values.map((value) => element("option", { value }, value)));
    if (values.includes(before)) select.value = before;
  };

  const shown = () => {
    const typed = words.value.trim().toLowerCase();
    const { column, falls } = sorted;
    const { of } = columns()[column];
    const kept = board().rows.filter(
      (row) =>
        row.method.toLowerCase().includes(typed) &&
        (chosenGiven.value === "all" || row.given === chosenGiven.value),
    );
    // What has no value stands last, whichever way it is sorted.
    return kept.sort((one, other) => {
      const [a, b] = [of(one), of(other)];
      if (a === null || b === null) return (a === null) - (b === null);
      const order = typeof a === "string" ? a.localeCompare(b) : a - b;
      return falls ? -order : order;
    });
  };

  const table = (rows) => {
    const heads = columns().map((column, at) => {
      const button = element("button", { type: "button" }, column.title || "rank");
      button.addEventListener("click", () => {
        sorted = { column: at, falls: sorted.column === at ? !sorted.falls : Boolean(column.falls) };
        draw();
        holder.querySelectorAll("button")[at].focus();
      });
      const order = sorted.column !== at ? "none" : sorted.falls ? "descending" : "ascending";
      return element("th", { scope: "col", "aria-sort": order, class: column.right ? "right" : "" }, button);
    });
    const lines = rows.map((row) =>
      element(
        "tr",
        {},
        ...columns().map((column) => {
          const inside = column.cell ? column.cell(row) : [String(column.text(row))];
          return element("td", { class: column.right ? "right" : "" }, ...inside);
        }),
      ),
    );
    return element("table", { class: "board" }, element("thead", {}, element("tr", {}, ...heads)), element("tbody", {}, ...lines));
  };

  const drawing = (rows) => {
    const metric = board().metrics[0];
    const points = rows.filter((row) => row.scores[0] !== null && row.seconds !== null);
    if (points.length < 2) return element("p", { class: "board-count" }, "No seconds to draw here.");
    const [width, height, left, bottom, top, right] = [720, 400, 60, 46, 14, 16];
    const times = points.map((row) => Math.log10(Math.max(row.seconds, 1e-4)));
    const [first, last] = [Math.floor(Math.min(...times)), Math.ceil(Math.max(...times) + 1e-9)];
    const most = 1.08 * Math.max(...points.map((row) => row.scores[0]));
    const x = (value) => left + ((Math.log10(Math.max(value, 1e-4)) - first) / (last - first)) * (width - left - right);
    const y = (value) => height - bottom - (value / most) * (height - bottom - top);
    const picture = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img",
      "aria-label": `${metric.title} against seconds per pair; the table has the same numbers` });
    for (let power = first; power <= last; power++) {
      const at = x(10 ** power);
      picture.append(
        svg("line", { x1: at, x2: at, y1: top, y2: height - bottom, class: "grid" }),
        svg("text", { x: at, y: height - bottom + 18, "text-anchor": "middle" }, String(Number((10 ** power).toPrecision(1)))),
      );
    }
    for (let step = 0; step <= 4; step++) {
      const value = (most * step) / 4;
      picture.append(
        svg("line", { x1: left, x2: width - right, y1: y(value), y2: y(value), class: "grid" }),
        svg("text", { x: left - 6, y: y(value) + 4, "text-anchor": "end" }, value.toFixed(3)),
      );
    }
    picture.append(
      svg("text", { x: (left + width - right) / 2, y: height - 6, "text-anchor": "middle" }, "seconds per pair, logarithmic"),
      svg("text", { x: 14, y: height / 2, transform: `rotate(-90 14 ${height / 2})`, "text-anchor": "middle" }, metric.title),
    );
    // Names keep clear of all marks and of each other; one that had to move gets a line.
    const taken = points.map((row) => ({ line: y(row.scores[0]) + 4, start: x(row.seconds) - 6, end: x(row.seconds) + 6 }));
    for (const row of [...points].sort((one, other) => one.scores[0] - other.scores[0])) {
      const [at, up] = [x(row.seconds), y(row.scores[0])];
      const label = row.method.length > 34 ? `${row.method.slice(0, 33)}…` : row.method;
      const wide = 6.2 * label.length;
      const places = [0, 13, -13, 26, -26, 39, -39, 52, -52].flatMap((step) => [
        { line: up + 4 + step, start: at + 10, end: at + 10 + wide },
        { line: up + 4 + step, start: at - 10 - wide, end: at - 10 },
      ]);
      const inside = places.filter((box) =>
        box.start > left && box.end < width - right && box.line > top + 8 && box.line < height - bottom - 2);
      const clear = (box) => taken.every((other) =>
        Math.abs(other.line - box.line) > 11 || other.end < box.start || other.start > box.end);
      const box = inside.find(clear) || inside[0] || places[0];
      taken.push(box);
      const onLeft = box.start < at;
      const link = svg("a", { href: row.file });
      if (Math.abs(box.line - up - 4) > 1) {
        link.append(svg("line", { x1: at, y1: up, x2: onLeft ? box.end + 2 : box.start - 2, y2: box.line - 4, class: "lead" }));
      }
      link.append(
        svg("circle", { cx: at, cy: up, r: 4.5 }),
        svg("text", { x: onLeft ? box.end : box.start, y: box.line, "text-anchor": onLeft ? "end" : "start" }, label),
        svg("title", {}, `${row.method}: ${number(row.scores[0])} in ${seconds(row.seconds)} s`),
      );
      picture.append(link);
    }
    return picture;
  };

  // Two pictures on each other; a slider says how much of the left one is seen.
  const compared = () => {
    const known = board().rows.map((row) => row.method).filter((name) => drawn.includes(name));
    const choices = ["truth", "infocus", ...new Set(known)];
    mapsTitle.hidden = maps.hidden = !board().drawn || !known.length;
    if (maps.hidden) return maps.replaceChildren();
    const [leftLabel, left] = chooser("left", choices);
    const [rightLabel, right] = chooser("right", choices);
    const pick = (select, name, other) => {
      select.value = choices.includes(asked.get(name)) ? asked.get(name) : other;
    };
    pick(left, "left", known[0]);
    pick(right, "right", "truth");
    const picture = () => element("img", { width: 320, height: 240, alt: "" });
    const [under, over] = [picture(), picture()];
    const slider = element("input", { type: "range", min: 0, max: 100, value: 50, "aria-label": "share of the left picture" });
    const show = () => {
      for (const [image, select] of [[over, left], [under, right]]) {
        image.src = `../assets/pictures/demo/${select.value}.jpg`;
        image.alt = `Kitchen of the demo set: ${select.value}`;
      }
      over.style.clipPath = `inset(0 ${100 - slider.value}% 0 0)`;
    };
    slider.addEventListener("input", show);
    for (const [select, name] of [[left, "left"], [right, "right"]]) {
      select.addEventListener("change", () => { asked.set(name, select.value); keep(); show(); });
    }
    show();
    return maps.replaceChildren(
      element("div", { class: "board-choice" }, leftLabel, rightLabel),
      element("div", { class: "board-pictures" }, under, over),
      slider,
      element("p", { class: "board-count" }, "Kitchen of the demo set, bright is near; a method of stacks alone has the same view as a stack of nine."),
    );
  };

  const csvOf = (rows) => {
    const heads = columns();
    // An apostrophe before what a spreadsheet would take for a formula.
    const plain = (text) => (/^\s*[=+\-@]/.test(text) && Number.isNaN(Number(text)) ? `'${text}` : String(text));
    const quoted = (text) => `"${plain(text).replaceAll('"', '""')}"`;
    const value = (column, row) => column.of(row) ?? "";
    const lines = [heads.map((column) => quoted(column.title || "rank")), ...rows.map((row) => heads.map((column) => quoted(value(column, row))))];
    return lines.map((line) => line.join(",")).join("\r\n") + "\r\n";
  };
  const download = element("a", { download: "ranking.csv" }, "this table as CSV");

  const keep = () => {
    const said = { set: chosenSet.value, protocol: chosenProtocol.value, given: chosenGiven.value, method: words.value.trim() };
    const first = { set: sets[0], protocol: boards.find((one) => one.set === chosenSet.value).protocol, given: "all", method: "" };
    for (const [name, value] of Object.entries(said)) {
      if (value === first[name]) asked.delete(name);
      else asked.set(name, value);
    }
    if (sorted.column || sorted.falls) asked.set("sort", `${sorted.falls ? "-" : ""}${sorted.column}`);
    else asked.delete("sort");
    const query = asked.toString();
    history.replaceState(null, "", `${location.pathname}${query && "?"}${query}${location.hash}`);
  };

  const draw = () => {
    const rows = shown();
    const all = board().rows.length;
    count.replaceChildren(`${rows.length} of ${all} methods; `, download);
    download.href = `data:text/csv;charset=utf-8,${encodeURIComponent(csvOf(rows))}`;
    holder.replaceChildren(table(rows));
    plot.replaceChildren(drawing(rows));
    const used = [...new Set(board().rows.flatMap((row) => row.machines))];
    machines.textContent = `Seconds: the median over pairs. Compare them only on one machine. Here: ${used.join("; ")}.`;
    keep();
  };
  const changeProtocol = () => {
    refill(chosenGiven, ["all", ...new Set(board().rows.map((row) => row.given))]);
    sorted = { column: 0, falls: false };
    compared();
    draw();
  };
  const changeSet = () => {
    refill(chosenProtocol, boards.filter((one) => one.set === chosenSet.value).map((one) => one.protocol));
    changeProtocol();
  };
  // What the address asks for, as far as it is there.
  const restore = () => {
    const wanted = Object.fromEntries(asked);
    const choose = (select, name, changed) => {
      if ([...select.options].some((option) => option.value === wanted[name])) select.value = wanted[name];
      changed();
    };
    words.value = wanted.method ?? "";
    choose(chosenSet, "set", changeSet);
    choose(chosenProtocol, "protocol", changeProtocol);
    const column = Math.abs(parseInt(wanted.sort, 10)) || 0;
    if (column < columns().length) sorted = { column, falls: (wanted.sort ?? "").startsWith("-") };
    choose(chosenGiven, "given", draw);
  };

  chosenSet.addEventListener("change", changeSet);
  chosenProtocol.addEventListener("change", changeProtocol);
  chosenGiven.addEventListener("change", draw);
  words.addEventListener("input", draw);
  place.replaceChildren(
    element("div", { class: "board-choice" }, setLabel, protocolLabel, givenLabel, wordsLabel),
    count,
    holder,
    mapsTitle,
    maps,
    element("h2", { id: "accuracy-against-seconds" }, "Accuracy against seconds"),
    plot,
    machines,
  );
  restore();
})();
