// The light and the line of trouble, which every page has.

import { byId, setText } from "./dom.js";

export function trouble(said) {
  setText(byId("trouble"), said);
  byId("trouble").hidden = !said;
}

// light: its colour and text; null: there is none.
export function showLight(light) {
  byId("light").className = light ? light.colour : "off";
  setText(byId("light-text"), light ? light.text : "no connection");
}

// Nothing on the page is of the present any more: the light is out, and says so.
export function gone(said) {
  document.querySelector("aside").inert = true;
  trouble(said);
  showLight(null);
}
