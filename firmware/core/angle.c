#include "angle.h"
#include "fixed.h"

/* Table and coefficients of minimax polynomials, in turns; tools/fit_angle.py computes and checks them. */

/* clang-format off */
const uint32_t plumb_angle_root[96] = {
    0xfffd03e9U, 0xfc1503bcU, 0xf8590393U, 0xf4c6036cU, 0xf15a0349U, 0xee110327U,
    0xeaea0308U, 0xe7e202ebU, 0xe4f802cfU, 0xe22802b5U, 0xdf73029dU, 0xdcd60286U,
    0xda500270U, 0xd7e0025cU, 0xd5840249U, 0xd33b0236U, 0xd1050225U, 0xcee00214U,
    0xcccc0205U, 0xcac701f6U, 0xc8d201e7U, 0xc6eb01daU, 0xc51101cdU, 0xc34401c0U,
    0xc18401b4U, 0xbfcf01a9U, 0xbe26019eU, 0xbc880194U, 0xbaf4018aU, 0xb96a0180U,
    0xb7ea0177U, 0xb673016eU, 0xb5040166U, 0xb39f015eU, 0xb2410156U, 0xb0eb014eU,
    0xaf9d0147U, 0xae560140U, 0xad160139U, 0xabdd0133U, 0xaaaa012cU, 0xa97e0126U,
    0xa8580120U, 0xa738011bU, 0xa61d0115U, 0xa5080110U, 0xa3f8010bU, 0xa2ee0106U,
    0xa1e80101U, 0xa0e800fcU, 0x9fec00f7U, 0x9ef400f3U, 0x9e0100efU, 0x9d1300eaU,
    0x9c2800e6U, 0x9b4200e2U, 0x9a5f00dfU, 0x998100dbU, 0x98a600d7U, 0x97cf00d4U,
    0x96fb00d0U, 0x962a00cdU, 0x955d00caU, 0x949400c7U, 0x93cd00c4U, 0x930900c1U,
    0x924900beU, 0x918b00bbU, 0x90d100b8U, 0x901900b5U, 0x8f6300b3U, 0x8eb100b0U,
    0x8e0100aeU, 0x8d5300abU, 0x8ca800a9U, 0x8bff00a6U, 0x8b5900a4U, 0x8ab500a2U,
    0x8a1300a0U, 0x8974009dU, 0x88d6009bU, 0x883b0099U, 0x87a20097U, 0x870a0095U,
    0x86750093U, 0x85e20092U, 0x85500090U, 0x84c0008eU, 0x8433008cU, 0x83a6008aU,
    0x831c0089U, 0x82930087U, 0x820c0085U, 0x81870084U, 0x81030082U, 0x80810081U};

static const int32_t SIN_Q31[4] = {
    1686629690, -173399356, 5346959, -77046};

static const int32_t COS_Q32[4] = {
    1324675872, -68093819, 1399910, -15167};

/* clang-format on */

uint32_t plumb_angle_length(int32_t y, int32_t x) {
    const uint64_t square = (uint64_t)mul_i64(y, y) + (uint64_t)mul_i64(x, x);
    const uint32_t hi = hi_u64(square), lo = lo_u64(square) | 1U;
    const unsigned n = (hi != 0U ? clz32(hi) : 32U + clz32(lo)) & ~1U;
    const uint32_t w = n < 32U ? hi << n | lo >> 1 >> (31U - n) : lo << (n - 32U);
    return angle_root_q29(w) << 1 >> (n >> 1);
}

void plumb_angle_sincos(int32_t turn_q32, int32_t *sin_q30, int32_t *cos_q30) {
    /* x: difference to the nearest quarter turn, in eighths of a turn, -1 <= x < 1 */
    const uint32_t quadrant = ((uint32_t)turn_q32 + (PLUMB_ANGLE_QUARTER_TURN >> 1)) >> 30;
    const int32_t x_q29 = wrap_i32((uint32_t)turn_q32 - (quadrant << 30));
    const int32_t square_q30 = (int32_t)(mul_i64(x_q29, x_q29) >> 28);

    int32_t p = SIN_Q31[3];
    p = angle_horner(SIN_Q31[2], p, square_q30);
    p = angle_horner(SIN_Q31[1], p, square_q30);
    p = angle_horner(SIN_Q31[0], p, square_q30);
    const int32_t sine = (int32_t)asr64(mul_i64(x_q29, p), 30);
    p = COS_Q32[3];
    p = angle_horner(COS_Q32[2], p, square_q30);
    p = angle_horner(COS_Q32[1], p, square_q30);
    p = angle_horner(COS_Q32[0], p, square_q30);
    const int32_t cosine = (1 << 30) - mulhi_i32(square_q30, p);

    const int32_t s = quadrant & 1U ? cosine : sine, c = quadrant & 1U ? sine : cosine;
    *sin_q30 = quadrant & 2U ? -s : s;
    *cos_q30 = (quadrant + 1U) & 2U ? -c : c;
}
