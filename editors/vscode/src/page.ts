// What a panel shows, and where the command can be.

export interface Answer {
  kind: "text" | "svg" | "html" | "error";
  content: string;
}

export function page(answer: Answer): string {
  if (answer.kind === "html") return answer.content;
  const body = answer.kind === "svg" ? answer.content : `<pre>${escaped(answer.content)}</pre>`;
  const style = "body{margin:1rem} svg{max-width:100%;height:auto;background:#fff} pre{white-space:pre-wrap}";
  return `<!doctype html><html><head><meta charset="utf-8"><style>${style}</style></head><body>${body}</body></html>`;
}

export function escaped(text: string): string {
  return text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
}

export function environments(folders: string[]): string[] {
  const names = [".venv", "venv", "env"].flatMap((name) => [`${name}/bin/lmoc`, `${name}/Scripts/lmoc.exe`]);
  return folders.flatMap((folder) => names.map((name) => `${folder}/${name}`));
}
