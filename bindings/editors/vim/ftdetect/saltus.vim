autocmd BufRead,BufNewFile *.salt setfiletype saltus
