// How the server is started: by the command of the settings, `cellwright` if there is none.
function server(settings) {
  const [command, ...args] = settings.get("command") || ["cellwright"];
  return { command, args: [...args, "lsp"] };
}

module.exports = { server };
