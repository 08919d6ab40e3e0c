" Saltus: comments, indentation of four columns; in Neovim also the language server.
if exists("b:did_ftplugin")
  finish
endif
let b:did_ftplugin = 1

setlocal commentstring=//\ %s comments=s1:/*,mb:*,ex:*/,:// expandtab shiftwidth=4 softtabstop=4 cindent
setlocal cinoptions+=:0
let b:undo_ftplugin = "setlocal commentstring< comments< expandtab< shiftwidth< softtabstop< cindent< cinoptions<"

" let g:saltus_lsp = 0 leaves the server to other plugins; g:saltus_command is what starts it.
if has("nvim") && get(g:, "saltus_lsp", 1)
  lua vim.lsp.start({ name = "saltus", cmd = vim.g.saltus_command or { "saltus", "lsp" }, root_dir = vim.fs.dirname(vim.api.nvim_buf_get_name(0)) })
endif
