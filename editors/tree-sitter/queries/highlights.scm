; Colours of lmo, by the capture names that Neovim, Helix and Emacs share.

(COMMENT) @comment
(description (STRING) @string.documentation)
(STRING) @string
(NUMBER) @number
[(true) (false)] @boolean

["end" "extends" "import" "within" "annotation" "constrainedby" "connect" "enumeration" "external"
 "equation" "algorithm" "public" "protected"] @keyword
["if" "then" "else" "elseif" "when" "elsewhen"] @keyword.conditional
["for" "in" "loop" "while"] @keyword.repeat
["return" "break"] @keyword.return
(class_kind) @keyword.type
(prefix) @keyword.modifier
(argument_prefix) @keyword.modifier
(base_prefix) @keyword.modifier
[(or_) (and_) (not_)] @keyword.operator
[(additive) (multiplicative) (power) (relational) "=" ":="] @operator
["(" ")" "[" "]" "{" "}"] @punctuation.bracket
["," ";" "." ":"] @punctuation.delimiter

(long_class (name) @type.definition)
(short_class (name) @type.definition)
(type_name) @type
(declaration (name) @variable.member)
(element_modification (path) @variable.parameter)
(named_argument (name) @variable.parameter)
(call (reference) @function.call)
(special_name) @function.builtin
((reference (part (name) @variable.builtin)) (#any-of? @variable.builtin "time" "end"))
