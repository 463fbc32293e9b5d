// The client of `lmoc lsp`, and the panels beside the text: the picture of a scene that follows edits, its equations, its run.

import * as vscode from "vscode";
import { LanguageClient, LanguageClientOptions, ServerOptions } from "vscode-languageclient/node";
import { Answer, page } from "./page";

const KINDS = ["run", "draw", "view", "equations"] as const;
type Kind = (typeof KINDS)[number];

let client: LanguageClient | undefined;

interface Beside {
  panel: vscode.WebviewPanel;
  uri: string;
  model: string | undefined;
}
let picture: Beside | undefined; // the one that follows edits

export async function activate(context: vscode.ExtensionContext): Promise<void> {
  for (const kind of KINDS) {
    context.subscriptions.push(vscode.commands.registerCommand(`lmo.${kind}`, () => show(kind)));
  }
  context.subscriptions.push(vscode.commands.registerCommand("lmo.restart", () => client?.restart()));
  context.subscriptions.push(vscode.workspace.onDidChangeTextDocument((e) => follow(e.document)));
  client = new LanguageClient("lmo", "lmo", server(), options());
  try {
    await client.start();
  } catch (error) {
    vscode.window.showErrorMessage(`lmoc lsp could not be started (pip install 'lmoc[editor]'): ${error}`);
  }
}

export function deactivate(): Thenable<void> | undefined {
  return client?.stop();
}

function server(): ServerOptions {
  const [command, ...args] = vscode.workspace.getConfiguration("lmo").get<string[]>("command") ?? ["lmoc", "lsp"];
  return { command, args };
}

function options(): LanguageClientOptions {
  return {
    documentSelector: [{ language: "lmo" }],
    middleware: {
      // the lenses above a model: their answers are shown here
      executeCommand: (command, args, next) => {
        const kind = command.replace("lmoc.", "") as Kind;
        return command.startsWith("lmoc.") && KINDS.includes(kind) ? show(kind, args[0], args[1]) : next(command, args);
      },
    },
  };
}

async function show(kind: Kind, uri?: string, model?: string): Promise<void> {
  const target = uri ?? vscode.window.activeTextEditor?.document.uri.toString();
  if (!client || !target) return;
  const answer = await ask(kind, target, model);
  const column = { viewColumn: vscode.ViewColumn.Beside, preserveFocus: true };
  const panel = vscode.window.createWebviewPanel("lmo", `${model ?? "lmo"}: ${kind}`, column, { enableScripts: kind === "view" });
  panel.webview.html = page(answer);
  if (kind === "draw") {
    picture?.panel.dispose();
    picture = { panel, uri: target, model };
    panel.onDidDispose(() => {
      if (picture?.panel === panel) picture = undefined;
    });
  }
}

function ask(kind: Kind, uri: string, model?: string): Promise<Answer> {
  return client!.sendRequest("workspace/executeCommand", { command: `lmoc.${kind}`, arguments: [uri, model ?? null] });
}

let waiting: NodeJS.Timeout | undefined;
let asks = 0;

function follow(document: vscode.TextDocument): void {
  if (picture?.uri !== document.uri.toString()) return;
  clearTimeout(waiting);
  waiting = setTimeout(async () => {
    const own = picture;
    if (!own) return;
    const asked = ++asks;
    const answer = await ask("draw", own.uri, own.model);
    if (picture !== own || asked !== asks) return; // another scene, or a newer text of this one
    if (answer.kind === "svg") own.panel.webview.html = page(answer); // while it is wrong, the last one stays
  }, 400);
}
