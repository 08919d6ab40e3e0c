#define E
#if E
#endif
void main() { E }
