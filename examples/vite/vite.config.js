// Writes an <img> for each photo of public/photos into the page, with its placeholder behind it.
import { readFileSync } from "node:fs";

const photos = JSON.parse(readFileSync("placeholders.json", "utf8"));

function image([path, { metadata: { width, height, dataURIBase64: uri, transparent } }]) {
  // The placeholder of a transparent photo, which would shine through it, goes when the photo has come.
  const gone = transparent ? ` onload="this.style.background='none'"` : "";
  return `<img src="/${path.split("/").map(encodeURIComponent).join("/")}" alt="" width="${width}" height="${height}" style="background:url('${uri}') center/cover"${gone}>`;
}

export default {
  plugins: [{
    name: "placeholders",
    transformIndexHtml: (html) => html.replace("<!-- photos -->", () => Object.entries(photos).map(image).join("\n")),
  }],
};
