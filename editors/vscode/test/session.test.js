// A session of the extension's protocol library against the language server: `lmoc` must be on the path.

const test = require("node:test");
const assert = require("node:assert");
const { spawn } = require("node:child_process");
const rpc = require("vscode-languageserver-protocol/node");

const TEXT = 'model First "A mass"\n  Fixd wall;\n  Mass mass(m = 2);\nend First;\n';

test("a slip is marked and its fix is offered", async () => {
  const [command, ...args] = (process.env.LMOC_LSP ?? "lmoc lsp").split(" ");
  const child = spawn(command, args);
  const c = rpc.createMessageConnection(new rpc.StreamMessageReader(child.stdout), new rpc.StreamMessageWriter(child.stdin));
  const said = new Promise((resolve) => c.onNotification("textDocument/publishDiagnostics", resolve));
  c.listen();
  const able = await c.sendRequest("initialize", { processId: process.pid, rootUri: null, capabilities: {} });
  assert.ok(able.capabilities.hoverProvider && able.capabilities.renameProvider);
  c.sendNotification("initialized", {});
  const uri = "file:///tmp/first.lmo";
  c.sendNotification("textDocument/didOpen", { textDocument: { uri, languageId: "lmo", version: 1, text: TEXT } });
  const { diagnostics } = await said;
  const slip = diagnostics.find((d) => d.code === "E0202");
  assert.deepEqual(slip.range, { start: { line: 1, character: 2 }, end: { line: 1, character: 6 } });
  const actions = await c.sendRequest("textDocument/codeAction", {
    textDocument: { uri }, range: slip.range, context: { diagnostics: [slip] },
  });
  assert.equal(actions[0].title, "Replace by 'Fixed'");
  await c.sendRequest("shutdown");
  c.sendNotification("exit");
});
