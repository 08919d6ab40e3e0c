;;; saltus-mode.el --- Saltus shaders  -*- lexical-binding: t; -*-

;; Version: 0.1
;; Package-Requires: ((emacs "27.1"))
;; Keywords: languages

;;; Commentary:

;; Colours and indentation of .salt files, and the language server by eglot (with Emacs 29, or from ELPA).
;; The lists of words are those of the compiler: tests/lsp/test_editors.py compares them.

;;; Code:

(defgroup saltus nil "Saltus shaders." :group 'languages)

(defcustom saltus-command '("saltus" "lsp")
  "What starts the language server."
  :type '(repeat string))

(defconst saltus-keywords
    '("if" "else" "for" "while" "do" "switch" "case" "default" "break" "continue" "return" "import"
      "const" "param" "struct" "typedef" "shader" "in" "out" "inout"))
(defconst saltus-constants
    '("true" "false" "PI" "TAU" "INFINITY" "EPSILON"))
(defconst saltus-types
    '("void" "bool" "int" "uint" "float" "bool2" "bool3" "bool4" "int2" "int3" "int4" "uint2"
      "uint3" "uint4" "float2" "float3" "float4" "float2x2" "float2x3" "float2x4" "float3x2"
      "float3x3" "float3x4" "float4x2" "float4x3" "float4x4" "texture2D" "texture3D" "heightfield"
      "mesh" "Hit" "Silhouette" "MeshHit" "Beam" "Piece" "AreaLight"))
(defconst saltus-functions
    '("abs" "sign" "floor" "ceil" "round" "trunc" "frac" "fmod" "min" "max" "clamp" "saturate"
      "lerp" "step" "smoothstep" "sqrt" "rsqrt" "cbrt" "pow" "exp" "exp2" "log" "log2" "sin" "cos"
      "tan" "asin" "acos" "atan" "atan2" "sinh" "cosh" "tanh" "erf" "fma" "isnan" "isinf" "isfinite"
      "dot" "cross" "length" "distance" "normalize" "reflect" "refract" "any" "all" "select" "mul"
      "transpose" "determinant" "inverse" "asuint" "asfloat" "hash" "detach" "dFdx" "dFdy" "rand"
      "rand2" "rand3" "pixel" "resolution" "sample_index" "len" "print" "assert" "init" "zeros"))
(defconst saltus-attributes
    '("NoDiff" "Range" "Doc" "Color" "Log" "Extent" "Height" "Vertex" "Tangent" "Domain" "Display"
      "Disc" "NoDisc" "SkipLoop" "MaxIters" "Cull"))

(defconst saltus-font-lock
  `((,(regexp-opt saltus-keywords 'symbols) . font-lock-keyword-face)
    (,(regexp-opt saltus-constants 'symbols) . font-lock-constant-face)
    (,(regexp-opt saltus-types 'symbols) . font-lock-type-face)
    (,(concat (regexp-opt saltus-functions 'symbols) "[ \t]*(") 1 font-lock-builtin-face)
    (,(concat "[[,][ \t]*" (regexp-opt saltus-attributes 'symbols)) 1 font-lock-preprocessor-face)
    ("\\_<\\([A-Za-z_][A-Za-z0-9_]*\\)[ \t]*(" 1 font-lock-function-name-face)))

(defvar saltus-mode-syntax-table
  (let ((table (make-syntax-table)))
    (modify-syntax-entry ?/ ". 124b" table)
    (modify-syntax-entry ?* ". 23" table)
    (modify-syntax-entry ?\n "> b" table)
    (modify-syntax-entry ?_ "_" table)
    (modify-syntax-entry ?\" "\"" table)
    table))

(defun saltus-indent-line ()
  "Four columns for each bracket that is open, none for one that the line closes."
  (interactive)
  (let* ((closes (save-excursion (back-to-indentation) (looking-at "[])}]\\|case\\_>\\|default\\_>")))
         (depth (save-excursion (back-to-indentation) (car (syntax-ppss))))
         (column (* 4 (max 0 (if closes (1- depth) depth)))))
    (if (<= (current-column) (current-indentation))
        (indent-line-to column)
      (save-excursion (indent-line-to column)))))

;;;###autoload
(define-derived-mode saltus-mode prog-mode "Saltus"
  "Major mode for shaders of Saltus."
  (setq-local font-lock-defaults '(saltus-font-lock)
              comment-start "// "
              comment-end ""
              comment-start-skip "//+[ \t]*"
              indent-line-function #'saltus-indent-line
              indent-tabs-mode nil))

;;;###autoload
(add-to-list 'auto-mode-alist '("\\.salt\\'" . saltus-mode))

(defvar eglot-server-programs)
(with-eval-after-load 'eglot
  (add-to-list 'eglot-server-programs (cons 'saltus-mode saltus-command)))

(provide 'saltus-mode)
;;; saltus-mode.el ends here
