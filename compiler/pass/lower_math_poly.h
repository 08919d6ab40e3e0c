/* Coefficients of lower_math: printed by tests/ir/fit_polynomials.py, which says how they were found. Do not edit. */
#ifndef SALTUS_PASS_LOWER_MATH_POLY_H
#define SALTUS_PASS_LOWER_MATH_POLY_H

/* pi and ln 2 in parts: for targets with fma full parts, without it parts short enough that multiples stay exact. */
static const double pi_fma_32[] = {0x1.921fb60000000p+1, -0x1.777a5c0000000p-24, -0x1.ee59da0000000p-49};
static const double pi_fma_64[] = {0x1.921fb54442d18p+1, 0x1.1a62633145c07p-53, -0x1.f1976b7ed8fbcp-109};
static const double pi_split_32[] = {0x1.9200000000000p+1, 0x1.fa00000000000p-11, 0x1.5400000000000p-19, 0x1.1000000000000p-29, 0x1.68c234c4c6629p-38};
static const double pi_split_64[] = {0x1.921fb54400000p+1, 0x1.0b4611a600000p-33, 0x1.3198a2e000000p-68, 0x1.b839a252049c1p-103};
static const double one_over_ln2_32[] = {0x1.7154760000000p+0, 0x1.4ae0c00000000p-26};
static const double ln2_fma_32[] = {0x1.62e4300000000p-1, -0x1.05c6100000000p-29};
static const double ln2_fma_64[] = {0x1.62e42fefa39efp-1, 0x1.abc9e3b39803fp-56};
static const double ln2_split_32[] = {0x1.62e4000000000p-1, 0x1.7f7d1cf79abcap-20};
static const double ln2_split_64[] = {0x1.62e42fefa2000p-1, 0x1.9ef35793c7673p-41};
static const double two_over_ln2_32[] = {0x1.7154760000000p+1, 0x1.4ae0c00000000p-25};
static const double two_over_ln2_64[] = {0x1.71547652b82fep+1, 0x1.777d0ffda0d24p-55};
static const double two_thirds_over_ln2_64[] = {0x1.ec709dc3a03fdp-1, 0x1.d27f05548af0cp-55};
/* sin_half_32: powers 3..9 on [0, 1.571], error 1e-08 */
static const double sin_half_32[] = {-0x1.55554c0000000p-3, 0x1.110ed40000000p-7, -0x1.9f70040000000p-13, 0x1.5dbe200000000p-19};
/* sin_quarter_32: powers 3..7 on [0, 0.7854], error 8.3e-09 */
static const double sin_quarter_32[] = {-0x1.5555460000000p-3, 0x1.11073a0000000p-7, -0x1.9943e00000000p-13};
/* cos_quarter_32: powers 4..8 on [0, 0.7854], error 1.7e-10 */
static const double cos_quarter_32[] = {0x1.55554a0000000p-5, -0x1.6c0c340000000p-10, 0x1.99eb980000000p-16};
/* exp_32: powers 1..5 on [-0.3466, 0.3466], error 9.5e-08 */
static const double exp_32[] = {0x1.fffff60000000p-1, 0x1.fffdc60000000p-2, 0x1.555a6a0000000p-3, 0x1.573a540000000p-5, 0x1.0fa82e0000000p-7};
/* exp2_32: powers 1..5 on [-0.5, 0.5], error 1.1e-07 */
static const double exp2_32[] = {0x1.62e42a0000000p-1, 0x1.ebf9bc0000000p-3, 0x1.c6b7520000000p-5, 0x1.3cea880000000p-7, 0x1.5bba0e0000000p-10};
/* log_32: powers 2..9 on [-0.2929, 0.4142], error 3.4e-08 */
static const double log_32[] = {-0x1.fffffa0000000p-2, 0x1.5556f40000000p-2, -0x1.00049a0000000p-2, 0x1.98d2be0000000p-3, -0x1.535d380000000p-3, 0x1.31853a0000000p-3, -0x1.25046a0000000p-3, 0x1.65c6800000000p-4};
/* log2_32: powers 1..9 on [-0.2929, 0.4142], error 6.4e-08 */
static const double log2_32[] = {0x1.7154760000000p+0, -0x1.7154700000000p-1, 0x1.ec73d60000000p-2, -0x1.715c4e0000000p-2, 0x1.26d3840000000p-2, -0x1.e95bf80000000p-3, 0x1.b9c93a0000000p-3, -0x1.a87c9e0000000p-3, 0x1.01b5fa0000000p-3};
/* pow_32: powers 3..7 on [0, 0.1716], error 1e-09 */
static const double pow_32[] = {0x1.ec70d20000000p-1, 0x1.274c580000000p-1, 0x1.b94b120000000p-2};
/* log_tail_32: powers 3..6 on [-0.0625, 0.0625], error 3.5e-10 */
static const double log_tail_32[] = {0x1.5555160000000p-2, -0x1.ffff780000000p-3, 0x1.9b31b40000000p-3, -0x1.56d87c0000000p-3};
/* log_near_32: powers 2..6 on [-0.0625, 0.0625], error 3.6e-10 */
static const double log_near_32[] = {-0x1.0000000000000p-1, 0x1.5555160000000p-2, -0x1.ffff4a0000000p-3, 0x1.9b32580000000p-3, -0x1.56f6260000000p-3};
/* asin_32: powers 3..11 on [0, 0.5], error 5.6e-09 */
static const double asin_32[] = {0x1.5555c80000000p-3, 0x1.3301e60000000p-4, 0x1.747e3e0000000p-5, 0x1.8c28640000000p-6, 0x1.596d360000000p-5};
/* atan_32: powers 3..17 on [0, 1], error 2.1e-08 */
static const double atan_32[] = {-0x1.5554dc0000000p-2, 0x1.9978f40000000p-3, -0x1.230ae00000000p-3, 0x1.b4e1440000000p-4, -0x1.3556de0000000p-4, 0x1.61fe1a0000000p-5, -0x1.0c2c460000000p-6, 0x1.7ed2620000000p-9};
/* sinh_32: powers 3..9 on [0, 1], error 5.2e-09 */
static const double sinh_32[] = {0x1.5555560000000p-3, 0x1.1111340000000p-7, 0x1.9ffe920000000p-13, 0x1.7a15b60000000p-19};
/* tanh_32: powers 3..11 on [0, 0.625], error 8.6e-09 */
static const double tanh_32[] = {-0x1.5555320000000p-2, 0x1.1107260000000p-3, -0x1.b83c5a0000000p-5, 0x1.52269a0000000p-6, -0x1.75e1c00000000p-8};
/* erf_32: powers 1..11 on [0, 0.875], error 7.5e-08 */
static const double erf_32[] = {0x1.20dd740000000p+0, -0x1.81270c0000000p-2, 0x1.ce211e0000000p-4, -0x1.b6f38c0000000p-6, 0x1.49ca040000000p-8, -0x1.453ac60000000p-11};
/* erfc_log2_32: powers 0..7 on [0.875, 4], error 1.2e-08 */
static const double erfc_log2_32[] = {0x1.ea38520000000p-13, -0x1.a124100000000p+0, -0x1.d3ebe20000000p-1, -0x1.3f83100000000p-3, 0x1.27c8fa0000000p-5, -0x1.8705200000000p-8, 0x1.430ae20000000p-11, -0x1.ef05140000000p-16};
/* rcbrt_32: powers 0..3 on [1, 2], error 0.00025 */
static const double rcbrt_32[] = {0x1.8ab9120000000p+0, -0x1.9eb2f20000000p-1, 0x1.4561e00000000p-2, -0x1.9914d20000000p-5};
/* sin_half_64: powers 3..21 on [0, 1.571], error 3.5e-17 */
static const double sin_half_64[] = {-0x1.5555555555555p-3, 0x1.1111111111111p-7, -0x1.a01a01a01a01ap-13, 0x1.71de3a556c716p-19, -0x1.ae64567f52938p-26, 0x1.6124613981a39p-33, -0x1.ae7f3dadd5f6ep-41, 0x1.952c1744a3bc5p-49, -0x1.2f2cdd3cbf7efp-57, 0x1.67e29d90c8c6ep-66};
/* sin_quarter_64: powers 3..15 on [0, 0.7854], error 6.3e-18 */
static const double sin_quarter_64[] = {-0x1.5555555555555p-3, 0x1.111111111110bp-7, -0x1.a01a01a018a6dp-13, 0x1.71de3a53308fap-19, -0x1.ae64528d8268ap-26, 0x1.61208c49cd6ebp-33, -0x1.aaa247e071b8ap-41};
/* cos_quarter_64: powers 4..16 on [0, 0.7854], error 1.2e-18 */
static const double cos_quarter_64[] = {0x1.5555555555555p-5, -0x1.6c16c16c16c0fp-10, 0x1.a01a01a018ccbp-16, -0x1.27e4fb75eb8dap-22, 0x1.1eed8c90cc0f1p-29, -0x1.9393241f5fa3bp-37, 0x1.aabd18ae0161ap-45};
/* exp_64: powers 1..11 on [-0.3466, 0.3466], error 1.2e-17 */
static const double exp_64[] = {0x1.0000000000000p+0, 0x1.000000000000bp-1, 0x1.55555555554b3p-3, 0x1.555555555018dp-5, 0x1.111111112f820p-7, 0x1.6c16c1855c5f5p-10, 0x1.a01a0111d2edep-13, 0x1.a0199757d56ebp-16, 0x1.71df48bc057ddp-19, 0x1.28af9b3993428p-22, 0x1.ad598c5e6823fp-26};
/* exp2_64: powers 1..11 on [-0.5, 0.5], error 2.8e-17 */
static const double exp2_64[] = {0x1.62e42fefa39efp-1, 0x1.ebfbdff82c5a4p-3, 0x1.c6b08d7049fe8p-5, 0x1.3b2ab6fba011bp-7, 0x1.5d87fe78cd6a3p-10, 0x1.4309130ed8985p-13, 0x1.ffcbfba98b602p-17, 0x1.62bfc79dbfbc9p-20, 0x1.b5267ccf414e7p-24, 0x1.e61b4ee697518p-28, 0x1.e79bc9a989190p-32};
/* log_64: powers 3..15 on [0, 0.1716], error 1.4e-18 */
static const double log_64[] = {0x1.5555555555592p-1, 0x1.999999997fef2p-2, 0x1.24924941e03b9p-2, 0x1.c71c5216c12c0p-3, 0x1.74663c3ac2f25p-3, 0x1.39a1fe23ea338p-3, 0x1.2f02cc26a3d8cp-3};
/* pow_64: powers 5..17 on [0, 0.1716], error 1.2e-20 */
static const double pow_64[] = {0x1.2776c50ef9d23p-1, 0x1.a61762a759bc3p-2, 0x1.484b14217352fp-2, 0x1.0c9a63e33219dp-2, 0x1.c69f87c4423c4p-3, 0x1.87b122fffc65ap-3, 0x1.85e5b3f80656bp-3};
/* asin_64: powers 3..27 on [0, 0.5], error 1.6e-18 */
static const double asin_64[] = {0x1.5555555555577p-3, 0x1.333333332e105p-4, 0x1.6db6db7214016p-5, 0x1.f1c71a947414ap-6, 0x1.6e8bdeec3a442p-6, 0x1.1c49ef9f5ff98p-6, 0x1.ca1f9d5fc46d6p-7, 0x1.758512cd2de56p-7, 0x1.613ef2ed2e39ep-7, 0x1.e5d3c2bbc5288p-9, 0x1.63a615d824c05p-6, -0x1.580a5eda821dep-6, 0x1.0b4a914481137p-5};
/* atan_64: powers 3..27 on [0, 0.4142], error 3.1e-18 */
static const double atan_64[] = {-0x1.5555555555555p-2, 0x1.9999999999970p-3, -0x1.2492492490a0dp-3, 0x1.c71c71c60cd3fp-4, -0x1.745d171273232p-4, 0x1.3b13aaf9230c9p-4, -0x1.11108cce98df5p-4, 0x1.e1d2a2bbe8cbcp-5, -0x1.ae89133f02484p-5, 0x1.817b081f22556p-5, -0x1.4c2f3c0b3c037p-5, 0x1.e51c920a2a740p-6, -0x1.a93fab89e7f23p-7};
/* sinh_64: powers 3..19 on [0, 1], error 8e-18 */
static const double sinh_64[] = {0x1.5555555555555p-3, 0x1.1111111111111p-7, 0x1.a01a01a01a01ap-13, 0x1.71de3a556c708p-19, 0x1.ae64567f59918p-26, 0x1.6124613467060p-33, 0x1.ae7f473883acap-41, 0x1.9524e7d7abcdcp-49, 0x1.32e1cc999ad1cp-57};
/* tanh_64: powers 3..25 on [0, 0.55], error 1.9e-18 */
static const double tanh_64[] = {-0x1.5555555555555p-2, 0x1.11111111110b1p-3, -0x1.ba1ba1ba143eep-5, 0x1.664f488078045p-6, -0x1.226e34f422b93p-7, 0x1.d6d3b83af84fdp-9, -0x1.7da17aa106497p-10, 0x1.353e13437bd4cp-11, -0x1.f392881c8db86p-13, 0x1.8a21a22e48a20p-14, -0x1.148bb4a7c68eap-15, 0x1.f3e5c8ff7cebap-18};
/* erf_64: powers 1..27 on [0, 1], error 4e-17 */
static const double erf_64[] = {0x1.20dd750429b6dp+0, -0x1.812746b0379e7p-2, 0x1.ce2f21a042bddp-4, -0x1.b82ce3128899bp-6, 0x1.565bcd0e64abap-8, -0x1.c02db3fed8ffep-11, 0x1.f9a326bfb84dap-14, -0x1.f4d255e1618dcp-17, 0x1.b9e64d095f816p-20, -0x1.5f6d6b62192b3p-23, 0x1.fc4117fe2cd36p-27, -0x1.4e55d0ac798bdp-30, 0x1.7ecc0c8e890d4p-34, -0x1.292923368928bp-38};
/* erfc_log2_64: powers 0..22 on [1, 6], error 2.2e-17 */
static const double erfc_log2_64[] = {0x1.4e1eb5547695cp-25, -0x1.a0be8c0c3cfb2p+0, -0x1.d63e759b67667p-1, -0x1.2fada9e40df49p-3, 0x1.c49df96176c23p-6, 0x1.ff2fba78d01a7p-13, -0x1.34ddc9c125992p-9, 0x1.8301cec8a0612p-11, 0x1.44e76122a02e8p-14, -0x1.8adefe231bd3dp-13, 0x1.c34ab4b4124fap-14, -0x1.54af15a7b27b1p-15, 0x1.81869f49aad55p-17, -0x1.4f675c1be59adp-19, 0x1.b6e882b9cd5a0p-22, -0x1.887f79022989fp-25, 0x1.23b973589a9b3p-29, 0x1.88ad3f61d087fp-32, -0x1.a78af23b8aa63p-34, 0x1.9c11ec36d2583p-37, -0x1.e3f22bee98d50p-41, 0x1.4ba82bb048fdep-45, -0x1.9bbb2b3aaeee9p-51};
/* rcbrt_64: powers 0..5 on [1, 2], error 5.7e-06 */
static const double rcbrt_64[] = {0x1.c7f368ef4313cp+0, -0x1.90e749aa79d3dp+0, 0x1.3e68bf882de47p+0, -0x1.321c605ecc2eap-1, 0x1.3fa263ea72747p-3, -0x1.16d6e2ecb0e0cp-6};

#endif
