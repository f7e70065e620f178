export default function (config) {
  config.addPassthroughCopy("photos");
}
