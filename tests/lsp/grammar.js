// Prints the scopes of every token of standard input, as vscode-textmate finds them with the grammar named on the command line.
const fs = require("fs");
const path = require("path");
const oniguruma = require("vscode-oniguruma");
const { Registry, INITIAL, parseRawGrammar } = require("vscode-textmate");

async function main() {
    const wasm = fs.readFileSync(path.join(path.dirname(require.resolve("vscode-oniguruma")), "onig.wasm"));
    await oniguruma.loadWASM(wasm.buffer.slice(wasm.byteOffset, wasm.byteOffset + wasm.byteLength));
    const registry = new Registry({
        onigLib: Promise.resolve({
            createOnigScanner: (patterns) => new oniguruma.OnigScanner(patterns),
            createOnigString: (text) => new oniguruma.OnigString(text),
        }),
        loadGrammar: async () => parseRawGrammar(fs.readFileSync(process.argv[2], "utf8"), process.argv[2]),
    });
    const grammar = await registry.loadGrammar("source.saltus");
    let state = INITIAL;
    for (const line of fs.readFileSync(0, "utf8").split("\n")) {
        const { tokens, ruleStack } = grammar.tokenizeLine(line, state);
        state = ruleStack;
        for (const t of tokens) console.log(JSON.stringify([line.slice(t.startIndex, t.endIndex), t.scopes]));
    }
}
main();
