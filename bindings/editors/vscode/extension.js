// The client of `saltus lsp`: starts it, and again where its command changes.
const { workspace, window } = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

let client;

async function start() {
    const settings = workspace.getConfiguration("saltus");
    const [command, ...args] = settings.get("command");
    const languages = settings.get("glsl") ? ["saltus", "glsl"] : ["saltus"];
    client = new LanguageClient("saltus", "Saltus", { command, args }, {
        documentSelector: languages.map((language) => ({ language })),
        synchronize: { fileEvents: workspace.createFileSystemWatcher("**/*.{salt,exr,png,pfm,npy,csv,json,obj,ply}") },
    });
    try {
        await client.start();
    } catch (error) {
        window.showErrorMessage(`Saltus: ${command} does not start (${error.message}); the setting saltus.command says what does.`);
    }
}

exports.activate = async (context) => {
    context.subscriptions.push(workspace.onDidChangeConfiguration(async (change) => {
        if (!change.affectsConfiguration("saltus")) return;
        await exports.deactivate();
        await start();
    }));
    await start();
};

exports.deactivate = async () => {
    const running = client;
    client = undefined;
    if (running) await running.stop().catch(() => {});
};
