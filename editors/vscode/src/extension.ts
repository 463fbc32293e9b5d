// The client of `lmoc lsp`, and the panels beside the text: the picture of a scene that follows edits, its equations, its run.

import { existsSync } from "node:fs";
import * as vscode from "vscode";
import { LanguageClient, LanguageClientOptions } from "vscode-languageclient/node";
import { Answer, environments, page } from "./page";

const KINDS = ["run", "draw", "view", "equations"] as const;
type Kind = (typeof KINDS)[number];

let client: LanguageClient | undefined;

interface Beside {
  panel: vscode.WebviewPanel;
  uri: string;
  model: string | undefined;
  drawn: boolean; // there has been a picture
}
let picture: Beside | undefined; // the one that follows edits

export async function activate(context: vscode.ExtensionContext): Promise<void> {
  for (const kind of KINDS) {
    context.subscriptions.push(vscode.commands.registerCommand(`lmo.${kind}`, () => show(kind)));
  }
  context.subscriptions.push(vscode.commands.registerCommand("lmo.restart", start));
  context.subscriptions.push(vscode.workspace.onDidChangeTextDocument((e) => follow(e.document)));
  context.subscriptions.push(vscode.workspace.onDidChangeConfiguration((e) => e.affectsConfiguration("lmo.command") && start()));
  await start();
}

export function deactivate(): Thenable<void> | undefined {
  return client?.isRunning() ? client.stop() : undefined;
}

async function start(): Promise<void> {
  const before = client;
  client = undefined;
  if (before?.isRunning()) await before.stop();
  const { command, args } = server();
  const made = new LanguageClient("lmo", "lmo", { command, args }, options());
  try {
    await made.start();
    client = made;
  } catch (error) {
    const set = "Set lmo.command";
    const text = `'${command}' could not be started (${error}). It comes with: pip install 'lmoc[editor]'; where it is not on the path, name it in lmo.command.`;
    vscode.window.showErrorMessage(text, set).then((chosen) => {
      if (chosen === set) vscode.commands.executeCommand("workbench.action.openSettings", "lmo.command");
    });
  }
}

// The command that is set; else `lmoc` of an environment in the folder that is open, as editors started from a menu have
// no environment on their path; else that of the path.
function server(): { command: string; args: string[] } {
  const set = vscode.workspace.getConfiguration("lmo").get<string[]>("command") ?? [];
  const [command, ...args] = set.length > 0 ? set : ["lmoc", "lsp"];
  const folders = (vscode.workspace.workspaceFolders ?? []).map((f) => f.uri.fsPath);
  const own = command === "lmoc" ? environments(folders).find((file) => existsSync(file)) : undefined;
  return { command: own ?? command, args };
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
  if (!target) return;
  if (!client) await start(); // the command can have been installed since
  if (!client) return; // it has been said why
  const answer = await ask(kind, target, model);
  const column = { viewColumn: vscode.ViewColumn.Beside, preserveFocus: true };
  const panel = vscode.window.createWebviewPanel("lmo", `${model ?? "lmo"}: ${kind}`, column, { enableScripts: kind === "view" });
  panel.webview.html = page(answer);
  if (kind === "draw") {
    picture?.panel.dispose();
    picture = { panel, uri: target, model, drawn: answer.kind === "svg" };
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
    if (!own || !client) return;
    const asked = ++asks;
    const answer = await ask("draw", own.uri, own.model);
    if (picture !== own || asked !== asks) return; // another scene, or a newer text of this one
    if (own.drawn && answer.kind !== "svg") return; // while it is wrong, the last picture stays
    own.drawn = answer.kind === "svg";
    own.panel.webview.html = page(answer);
  }, 400);
}
