/* A second thread beside a call: what is done in which order, by whom, and when it ends. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
#include <stdatomic.h>
#include <string.h>
#include <time.h>

#include "runtime/base/side.h"

typedef struct Piece {
    SideWork work;
    atomic_int *order; /* how many have been done */
    int at;
    pthread_t by;
    atomic_bool begun, may_end;
} Piece;

static void rest(void) { nanosleep(&(struct timespec){.tv_nsec = 100000}, NULL); }

static void run(void *arg) {
    Piece *p = arg;
    p->by = pthread_self(), p->begun = true;
    while (!p->may_end) rest();
    p->at = ++*p->order;
}

static Piece *piece(Piece *p, atomic_int *order, bool may_end, bool yields) {
    memset(p, 0, sizeof *p);
    p->work = (SideWork){.run = run, .arg = p, .yields = yields};
    p->order = order, p->may_end = may_end;
    return p;
}

static bool is_here(const Piece *p) { return pthread_equal(p->by, pthread_self()); }

static void none(void **state) {
    Side s;
    Piece p;
    atomic_int order = 0;
    (void)state;
    side_begin(&s, false, 0);
    assert_false(side_add(&s, &piece(&p, &order, true, false)->work));
    side_finish(&s, &p.work), side_last(&s), side_end(&s);
    assert_false(side_add(NULL, &p.work));
    side_finish(NULL, &p.work), side_last(NULL);
    assert_int_equal(order, 0);
}

/* Behind a piece that runs: pieces that yield come last, and the caller does what waits while the first is not done. */
static void in_order(void **state) {
    Side s;
    Piece first, second, third, late;
    atomic_int order = 0;
    (void)state;
    side_begin(&s, true, 1 << 20);
    assert_true(side_add(&s, &piece(&first, &order, false, false)->work));
    while (!first.begun) rest();
    assert_true(side_add(&s, &piece(&late, &order, true, true)->work));
    assert_true(side_add(&s, &piece(&second, &order, true, false)->work));
    assert_true(side_add(&s, &piece(&third, &order, true, false)->work));
    side_finish(&s, &third.work);
    assert_true(is_here(&third) && third.at == 1);
    first.may_end = true;
    side_finish(&s, &first.work); /* may do the second and the late one here */
    assert_false(is_here(&first));
    side_finish(&s, &second.work), side_finish(&s, &late.work);
    assert_int_equal(order, 4);
    assert_true(late.at > second.at);
    side_end(&s);
}

/* What waits is done although nothing comes after it; then the caller is alone. */
static void last(void **state) {
    Side s;
    Piece first, second, third;
    atomic_int order = 0;
    (void)state;
    side_begin(&s, true, 0);
    assert_true(side_add(&s, &piece(&first, &order, false, false)->work));
    while (!first.begun) rest();
    assert_true(side_add(&s, &piece(&second, &order, true, false)->work));
    side_last(&s);
    assert_false(side_add(&s, &piece(&third, &order, true, false)->work));
    first.may_end = true;
    while (order < 2) rest();
    assert_false(is_here(&second));
    side_finish(&s, &second.work), side_finish(&s, &first.work), side_end(&s);
    assert_int_equal(order, 2);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(none), cmocka_unit_test(in_order), cmocka_unit_test(last)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
