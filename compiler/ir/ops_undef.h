/* No include guard: forgets the row macros after each inclusion of ops.def. */
#undef FOP1
#undef FOP2
#undef FOP3
#undef FCMP2
#undef FSEL
#undef IOP1
#undef IOP2
#undef ICMP2
#undef BOP1
#undef BOP2
#undef CONV
#undef SPECIAL
