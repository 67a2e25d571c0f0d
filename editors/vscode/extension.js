// Starts `cellwright lsp` and shows what it says. Everything else is the server's.
const { LanguageClient, TransportKind } = require("vscode-languageclient/node");
const { server } = require("./server");
const vscode = require("vscode");

let client;

function activate(context) {
  const { command, args } = server(vscode.workspace.getConfiguration("cellwright"));
  client = new LanguageClient(
    "cellwright",
    "Cellwright",
    { command, args, transport: TransportKind.stdio },
    {
      documentSelector: [
        { scheme: "file", pattern: "**/{domain,cell,contacts,faults,device}.{yaml,yml}" },
        { scheme: "file", pattern: "**/{problems,large}/*.{yaml,yml}" },
        { scheme: "file", language: "asp" },
      ],
      synchronize: { fileEvents: vscode.workspace.createFileSystemWatcher("**/*.{yaml,yml,lp}") },
    },
  );
  context.subscriptions.push(
    vscode.commands.registerCommand("cellwright.restart", () => client.restart()),
  );
  return client.start();
}

function deactivate() {
  return client && client.stop();
}

module.exports = { activate, deactivate };
