// Speaks to the server as the editor does, through the protocol library of VS Code: node test.js [COMMAND...]
const { spawn } = require("child_process");
const fs = require("fs");
const os = require("os");
const path = require("path");
const { pathToFileURL } = require("url");
const rpc = require("vscode-languageserver-protocol/node");
const { server } = require("./server");

const DOMAIN = `domain: shelf
types:
  place: object
  box: object
objects:
  place: [floor, board]
  box: [red]
fluents:
  at(box, place): {weight: 1}
operators:
  move(Box, From, To):
    where: From != To
    preconditions: att(Box, From)
    adds: at(Box, To)
    deletes: at(Box, From)
`;

async function main() {
  const folder = fs.mkdtempSync(path.join(os.tmpdir(), "cellwright-"));
  const file = path.join(folder, "domain.yaml");
  fs.writeFileSync(file, DOMAIN);
  const uri = pathToFileURL(file).href;
  const own = process.argv.slice(2);
  const { command, args } = server({ get: () => (own.length ? own : undefined) });
  const child = spawn(command, args, { stdio: ["pipe", "pipe", "inherit"] });
  const connection = rpc.createProtocolConnection(
    new rpc.StreamMessageReader(child.stdout),
    new rpc.StreamMessageWriter(child.stdin),
  );
  const told = new Promise((found) =>
    connection.onNotification(rpc.PublishDiagnosticsNotification.type, (said) => {
      if (said.uri === uri && said.diagnostics.length) found(said.diagnostics);
    }),
  );
  connection.listen();
  const answer = await connection.sendRequest(rpc.InitializeRequest.type, {
    processId: process.pid,
    rootUri: pathToFileURL(folder).href,
    capabilities: {},
  });
  await connection.sendNotification(rpc.InitializedNotification.type, {});
  await connection.sendNotification(rpc.DidOpenTextDocumentNotification.type, {
    textDocument: { uri, languageId: "yaml", version: 1, text: DOMAIN },
  });
  const line = DOMAIN.split("\n").findIndex((each) => each.includes("att("));
  const diagnostics = await told;
  expect(diagnostics[0].message.includes("did you mean 'at'"), JSON.stringify(diagnostics));
  const actions = await connection.sendRequest(rpc.CodeActionRequest.type, {
    textDocument: { uri },
    range: diagnostics[0].range,
    context: { diagnostics },
  });
  expect(actions[0].edit.changes[uri][0].newText === "at", JSON.stringify(actions));
  const hover = await connection.sendRequest(rpc.HoverRequest.type, {
    textDocument: { uri },
    position: { line: line + 1, character: 10 },
  });
  expect(hover.contents.value.includes("at(box, place)"), JSON.stringify(hover));
  await connection.sendRequest(rpc.ShutdownRequest.type);
  await connection.sendNotification(rpc.ExitNotification.type);
  const code = await new Promise((ended) => child.on("exit", ended));
  expect(code === 0, `exit code ${code}`);
  fs.rmSync(folder, { recursive: true });
  console.log(`${Object.keys(answer.capabilities).length} capabilities; diagnostics, fixes and hover are right`);
  process.exit(0);
}

function expect(so, otherwise) {
  if (!so) {
    console.error(`not as expected: ${otherwise}`);
    process.exit(1);
  }
}

setTimeout(() => expect(false, "no answer within two minutes"), 120_000).unref();
main().catch((error) => expect(false, error.stack));
