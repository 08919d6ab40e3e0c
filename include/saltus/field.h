#include "saltus/heightfield.h"
#define SltField SltGeometry
#define SltFieldWhat SltQuery
#define SltFieldQuery SltQueryFn
#define SLT_FIELD_TRACE SLT_QUERY_TRACE
#define SLT_FIELD_OCCLUDED SLT_QUERY_OCCLUDED
#define SLT_FIELD_RISE SLT_QUERY_RISE
