// Controls of the less used options, made from the server's description of the options.

import { make } from "./dom.js";

const LIMIT = "max_bytes", GZIPPED = "count_gzipped"; // the second says which bytes the first limits
const FLAG = /--[a-z][a-z0-9-]*/g;

/** @import { Group, Option, Options, Value } from "./api.js" */
/** @typedef {{ option: Option, control: HTMLInputElement | HTMLSelectElement, row: HTMLElement, home: Comment, note: HTMLElement, error: HTMLElement }} OptionField */

export class More {
  /** @param {Group[]} groups */
  constructor(groups) {
    this.fields = /** @type {Map<string, OptionField>} */ (new Map()); // keys are names of options
    for (const group of groups) {
      const rows = group.options.flatMap((option) => this.row(option));
      by("groups").append(make("details", { class: "group" },
        make("summary", {}, group.title), make("div", { class: "options" }, ...rows)));
    }
    by("goal").addEventListener("input", () => this.count());
    by("reset").addEventListener("click", () => {
      for (const one of this.fields.values()) this.set(one, one.option.default);
      this.count();
    });
    this.count();
  }

  /**
   * Returns the mark of an option's place in its group, and its row.
   * @param {Option} option
   */
  row(option) {
    const id = `option-${option.name}`, help = `${id}-help`, line = `${id}-error`;
    const control = this.control(option, { id, "aria-describedby": `${id}-note ${help} ${line}` });
    const error = make("p", { class: "error", id: line, role: "alert", hidden: true });
    const note = make("p", { class: "note", id: `${id}-note` });
    const label = make("label", { for: id }, option.label);
    const unit = option.unit ? make("span", { class: "soft" }, ` ${option.unit}`) : null;
    const row = make("div", { class: option.type === "boolean" ? "option bool" : "option" },
      note, label, make("span", { class: "value" }, control, unit),
      make("p", { class: "help", id: help }, option.help, " ", make("code", {}, option.flag ?? "")), error);
    const field = { option, control, row, home: new Comment(), note, error };
    this.fields.set(option.name, field);
    this.set(field, option.default);
    return [field.home, row];
  }

  /** @param {Option} option @param {import("./dom.js").Attributes} attributes */
  control(option, attributes) {
    if (option.type === "boolean") return make("input", { type: "checkbox", ...attributes });
    if (option.type === "choice") {
      const choices = (option.choices ?? []).map((one) => make("option", { value: one }, String(one)));
      if (option.default === null) choices.unshift(make("option", { value: "" }, "automatic"));
      return make("select", attributes, ...choices);
    }
    if (option.type === "text" || option.type === "size") return make("input", { type: "text", autocomplete: "off", placeholder: "automatic", ...attributes });
    return make("input", {
      type: "number", step: option.type === "integer" ? 1 : "any", min: option.min, max: option.max,
      placeholder: option.default === null ? "automatic" : "", ...attributes,
    });
  }

  /** @param {OptionField} field @param {Value} value */
  set({ control }, value) {
    if (isCheckbox(control)) control.checked = value === true;
    else control.value = String(value ?? "");
  }

  /** @param {OptionField} field */
  value({ option, control }) {
    if (isCheckbox(control)) return control.checked;
    if (control.value === "") return option.default;
    if (option.type === "integer" || option.type === "number") return Number(control.value);
    if (option.type === "choice") return option.choices?.find((one) => String(one) === control.value) ?? null;
    return control.value;
  }

  /**
   * Hides the row of the option that the main control sets, and shows the others.
   * @param {string} main name of that option
   */
  leaveOut(main) {
    for (const [name, field] of this.fields) {
      field.row.hidden = name === main;
      if (name === GZIPPED && main !== LIMIT) this.set(field, field.option.default);
    }
    this.count();
  }

  /**
   * Sets options as a first choice does.
   * @param {Options} values values of options. All other options of `names` get their defaults
   * @param {string[]} names names of the options that any first choice sets
   */
  assign(values, names) {
    for (const name of names) {
      const field = this.fields.get(name);
      if (field) this.set(field, values[name] ?? field.option.default);
    }
    this.count();
  }

  /**
   * Shows each note beside the control of the option that it names. Controls with notes and those of
   * `names` stand below the main control, and all others are folded away. Returns the other notes.
   * @param {string[]} notes
   * @param {string[]} names names of options
   * @param {string} main name of the option that the main control sets
   */
  arrange(notes, names, main) {
    const fields = [...this.fields.values()], others = /** @type {string[]} */ ([]);
    for (const place of [by("goal-note"), ...fields.map((one) => one.note)]) place.textContent = "";
    for (const line of notes) {
      const field = fields.find(({ option }) => option.flag && line.match(FLAG)?.includes(option.flag));
      if (!field) others.push(line);
      else (field.option.name === main ? by("goal-note") : field.note).append(`${line[0].toUpperCase()}${line.slice(1)}. `);
    }
    const focused = document.activeElement;
    for (const { option, row, home, note } of fields) {
      const isUp = note.textContent !== "" || names.includes(option.name) || (option.name === GZIPPED && main === LIMIT);
      if (isUp !== (row.parentElement === by("set"))) {
        if (isUp) by("set").append(row);
        else home.after(row);
      }
    }
    if (focused instanceof HTMLElement) focused.focus({ preventScroll: true }); // a row that moves loses it
    return others;
  }

  /**
   * Returns the options that differ from their defaults.
   * @param {string} main name of the option that the main control sets, which is left out
   */
  chosen(main) {
    const chosen = /** @type {Options} */ ({});
    for (const [name, field] of this.fields) {
      const value = this.value(field);
      if (name !== main && value !== field.option.default) chosen[name] = value;
    }
    return chosen;
  }

  count() {
    let changed = 0;
    for (const field of this.fields.values()) {
      const isChanged = this.value(field) !== field.option.default;
      field.row.classList.toggle("changed", isChanged);
      changed += Number(isChanged);
      field.error.hidden = true;
    }
    by("changed").textContent = changed ? `${changed} changed` : "";
    by("reset").hidden = changed === 0;
  }

  // Returns whether all fields are valid. The first that is not gets the focus.
  check() {
    const bad = [...this.fields.values()].find((field) => !field.control.validity.valid);
    if (bad) this.refuse(bad, bad.control.validationMessage);
    return !bad;
  }

  /**
   * Shows an error of the server at the option that it names. Returns whether it is visible there.
   * @param {string} line
   */
  blame(line) {
    const field = this.fields.get(/^[a-z_]+/.exec(line)?.[0] ?? "");
    if (field) this.refuse(field, line);
    return field !== undefined && field.error.checkVisibility();
  }

  /**
   * Shows an error at a field, and focuses it.
   * @param {OptionField} field
   * @param {string} line
   */
  refuse({ control, row, error }, line) {
    error.textContent = line;
    error.hidden = false;
    for (let one = row.closest("details"); one; one = one.parentElement?.closest("details") ?? null) one.open = true;
    control.focus();
  }
}

/** @param {HTMLInputElement | HTMLSelectElement} control @returns {control is HTMLInputElement} */
const isCheckbox = (control) => control.type === "checkbox";
