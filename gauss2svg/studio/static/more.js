// Controls of the less used options, made from the server's description of the options.

import { make } from "./dom.js";

/** @import { Group, Option, Options, Value } from "./api.js" */
/** @typedef {{ option: Option, control: HTMLInputElement | HTMLSelectElement, row: HTMLElement, error: HTMLElement }} OptionField */

export class More {
  /** @param {Group[]} groups */
  constructor(groups) {
    this.fields = /** @type {Map<string, OptionField>} */ (new Map()); // keys are names of options
    for (const group of groups) {
      const rows = group.options.map((option) => this.row(option));
      by("groups").append(make("details", { class: "group" },
        make("summary", {}, group.title), make("div", { class: "options" }, ...rows)));
    }
    by("groups").addEventListener("input", () => this.count());
    by("reset").addEventListener("click", () => {
      for (const one of this.fields.values()) this.set(one, one.option.default);
      this.count();
    });
    this.count();
  }

  /** @param {Option} option */
  row(option) {
    const id = `option-${option.name}`, help = `${id}-help`, line = `${id}-error`;
    const control = this.control(option, { id, "aria-describedby": `${help} ${line}` });
    const error = make("p", { class: "error", id: line, role: "alert", hidden: true });
    const label = make("label", { for: id }, option.label);
    const unit = option.unit ? make("span", { class: "soft" }, ` ${option.unit}`) : null;
    const row = make("div", { class: option.type === "boolean" ? "option bool" : "option" },
      label, make("span", { class: "value" }, control, unit),
      make("p", { class: "help", id: help }, option.help, " ", make("code", {}, option.flag ?? "")), error);
    const field = { option, control, row, error };
    this.fields.set(option.name, field);
    this.set(field, option.default);
    return row;
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
    for (const [name, field] of this.fields) field.row.hidden = name === main;
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
    by("more", HTMLDetailsElement).open = true;
    row.closest("details")?.setAttribute("open", "");
    control.focus();
  }
}

/** @param {HTMLInputElement | HTMLSelectElement} control @returns {control is HTMLInputElement} */
const isCheckbox = (control) => control.type === "checkbox";
