" Saltus. The lists are those of the compiler: tests/lsp/test_editors.py compares them.
if exists("b:current_syntax")
  finish
endif

syn keyword saltusStatement if else for while do switch case default break continue return
syn keyword saltusStorage import const param struct typedef shader in out inout
syn keyword saltusBoolean true false
syn keyword saltusType void bool int uint float bool2 bool3 bool4 int2 int3 int4 uint2 uint3 uint4 float2
syn keyword saltusType float3 float4 float2x2 float2x3 float2x4 float3x2 float3x3 float3x4 float4x2 float4x3
syn keyword saltusType float4x4 texture2D texture3D heightfield mesh Hit Silhouette MeshHit Beam Piece
syn keyword saltusType AreaLight
syn keyword saltusConstant PI TAU INFINITY EPSILON
syn keyword saltusFunction abs sign floor ceil round trunc frac fmod min max clamp saturate lerp step
syn keyword saltusFunction smoothstep sqrt rsqrt cbrt pow exp exp2 log log2 sin cos tan asin acos atan atan2
syn keyword saltusFunction sinh cosh tanh erf fma isnan isinf isfinite dot cross length distance normalize
syn keyword saltusFunction reflect refract any all select mul transpose determinant inverse asuint asfloat
syn keyword saltusFunction hash detach dFdx dFdy rand rand2 rand3 pixel resolution sample_index len print
syn keyword saltusFunction assert init zeros
syn keyword saltusAttribute contained NoDiff Range Doc Color Log Extent Height Vertex Tangent Domain Display
syn keyword saltusAttribute contained Disc NoDisc SkipLoop MaxIters Cull
syn region saltusAttributes matchgroup=saltusBracket start="\%(\w\|\]\|)\)\@1<!\[\ze\s*\u" end="\]" contains=saltusAttribute,saltusString,saltusNumber,saltusFloat,saltusType,saltusConstant,saltusFunction,saltusComment

syn match saltusNumber "\<0[xX]\x\+[uU]\?\>\|\<\d\+[uU]\?\>"
syn match saltusFloat "\<\d\+\.\d*\%([eE][-+]\?\d\+\)\?[fF]\?\|\.\d\+\%([eE][-+]\?\d\+\)\?[fF]\?\|\<\d\+[eE][-+]\?\d\+[fF]\?\>"
syn region saltusString start=+"+ skip=+\\.+ end=+"\|$+
syn keyword saltusTodo TODO FIXME XXX contained
syn match saltusComment "//.*$" contains=saltusTodo,@Spell
syn region saltusComment start="/\*" end="\*/" contains=saltusTodo,@Spell

hi def link saltusStatement Statement
hi def link saltusStorage StorageClass
hi def link saltusBoolean Boolean
hi def link saltusType Type
hi def link saltusConstant Constant
hi def link saltusFunction Function
hi def link saltusAttribute PreProc
hi def link saltusBracket PreProc
hi def link saltusNumber Number
hi def link saltusFloat Float
hi def link saltusString String
hi def link saltusTodo Todo
hi def link saltusComment Comment

let b:current_syntax = "saltus"
